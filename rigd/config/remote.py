"""The ``remote:`` section of a rig file: endpoints, certificates, roles."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from ipaddress import ip_address
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, Self

if TYPE_CHECKING:  # the processes of a run, and clients, read no rig file
    from rigd.config.document import Document
    from rigd.config.problems import Problems
    from rigd.config.source import RemoteSource, TlsSource

#: Where a daemon listens unless its rig file says otherwise: zenoh's own port, this machine only.
DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"

_ENDPOINT: Final = re.compile(
    r"(?P<protocol>tcp|tls)/(?:\[(?P<six>[0-9A-Fa-f:.]+)\]|(?P<host>[A-Za-z0-9.-]+)):"
    r"(?P<port>[0-9]{1,5})"
)


@dataclass(frozen=True)
class Endpoint:
    """An address in zenoh's words: ``tls/0.0.0.0:7447``, ``tcp/[::1]:7447``."""

    protocol: str
    """``tcp`` or ``tls``."""
    host: str
    """A name or an address, without brackets."""
    port: int

    @classmethod
    def read(cls, text: str) -> Self | None:
        """Return the address that ``text`` says; None where it is none."""
        match = _ENDPOINT.fullmatch(text)
        if match is None or not 0 < int(match["port"]) < 2**16:
            return None
        return cls(match["protocol"], match["six"] or match["host"], int(match["port"]))


@dataclass(frozen=True)
class TlsFiles:
    """What one end of a connection proves itself with: PEM files, by absolute path.

    ``ca`` signs everybody who is trusted, ``certificate`` and ``key`` are one's own.
    """

    ca: Path
    certificate: Path
    key: Path


@dataclass(frozen=True)
class RemoteSetup:
    """Where a daemon listens, what it proves itself with, and who may do what.

    Without ``tls`` every endpoint is on this machine's loopback, and an identity is the name that
    a client gives itself; with it, the common name of its certificate.
    """

    listen: tuple[str, ...] = (DEFAULT_ENDPOINT,)
    tls: TlsFiles | None = None
    roles: Mapping[str, Literal["observer", "operator", "maintainer"]] = field(default_factory=dict)


def read_remote(document: Document, source: RemoteSource | None, problems: Problems) -> RemoteSetup:
    """Return what the rig file says of remote control; problems are noted in ``problems``."""
    if source is None:
        return RemoteSetup()
    for index, endpoint in enumerate(source.listen):
        _check_endpoint(document, index, endpoint, source.tls is not None, problems)
    if source.tls is not None and not source.roles:
        problems.add(
            document.key_place(("remote", "tls")),
            "nobody could connect: with TLS, only who has a role may",
            "add 'roles: {NAME: operator}', by the names in the certificates",
        )
    tls = None if source.tls is None else _files(source.tls, document.path.parent)
    return RemoteSetup(tuple(source.listen), tls, dict(source.roles))


def _files(source: TlsSource, folder: Path) -> TlsFiles:
    # Whether they are there is for the daemon to see: a rig file is checked on other machines too.
    return TlsFiles(
        *((folder / name).absolute() for name in (source.ca, source.certificate, source.key))
    )


def _check_endpoint(
    document: Document, index: int, endpoint: str, has_tls: bool, problems: Problems
) -> None:
    place = document.place(("remote", "listen", index))
    read = Endpoint.read(endpoint)
    if read is None:
        problems.add(
            place, f"{endpoint!r} is not an address to listen on",
            "such as tcp/127.0.0.1:7447 or, with certificates, tls/0.0.0.0:7447",
        )  # fmt: skip
    elif has_tls and read.protocol != "tls":
        problems.add(place, f"{endpoint} would let in whoever has no certificate",
                     f"write tls{endpoint[3:]}")  # fmt: skip
    elif not has_tls and read.protocol == "tls":
        problems.add(place, f"{endpoint} needs certificates",
                     "add 'tls: {ca: ..., certificate: ..., key: ...}'; "
                     "rigd remote setup-tls makes them")  # fmt: skip
    elif not has_tls and not _is_loopback(read.host):
        problems.add(
            place, f"{endpoint} can be reached from other machines, by anybody",
            "listen on tcp/127.0.0.1 only, or add 'tls: ...' and write "
            f"tls{endpoint[3:]}; rigd remote setup-tls makes the certificates",
        )  # fmt: skip


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False  # a name, even localhost, means what the resolver says
