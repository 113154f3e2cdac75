"""Reads the ``remote:`` section of a rig file: endpoints, certificates, roles."""

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

#: The address of a daemon without an entry in its rig file: zenoh's own port, this machine only.
DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
#: The name by which a program on the same machine reaches a daemon that listens everywhere.
HERE: Final = "localhost"

_ENDPOINT: Final = re.compile(
    r"(?P<protocol>tcp|tls)/(?:\[(?P<six>[0-9A-Fa-f:.]+)\]|(?P<host>[A-Za-z0-9.-]+)):"
    r"(?P<port>[0-9]{1,5})"
)


@dataclass(frozen=True)
class Endpoint:
    """A network address in the form of zenoh: ``tls/0.0.0.0:7447``, ``tcp/[::1]:7447``."""

    protocol: str
    """``tcp`` or ``tls``."""
    host: str
    """A host name or an address, without brackets."""
    port: int

    @classmethod
    def read(cls, text: str) -> Self | None:
        """Return the address in ``text``; None if it is not an address."""
        match = _ENDPOINT.fullmatch(text)
        if match is None or not 0 < int(match["port"]) < 2**16:
            return None
        return cls(match["protocol"], match["six"] or match["host"], int(match["port"]))


@dataclass(frozen=True)
class TlsFiles:
    """The certificate files of one end of a connection: PEM files, by absolute path.

    ``ca`` is the authority that both ends trust; ``certificate`` and ``key`` belong to this end.
    """

    ca: Path
    certificate: Path
    key: Path


@dataclass(frozen=True)
class RemoteSetup:
    """The addresses and certificates of a daemon, and the roles of its clients.

    Without ``tls`` every endpoint is on this machine's loopback, and the identity of a client is
    the name that it gives itself; with ``tls`` it is the common name of its certificate.
    """

    listen: tuple[str, ...] = (DEFAULT_ENDPOINT,)
    tls: TlsFiles | None = None
    roles: Mapping[str, Literal["observer", "operator", "maintainer"]] = field(default_factory=dict)

    @property
    def endpoint(self) -> str:
        """The address at which a program on the same machine reaches the daemon."""
        protocol, _, address = self.listen[0].partition("/")
        host, _, port = address.rpartition(":")
        return f"{protocol}/{HERE if host in ('0.0.0.0', '[::]') else host}:{port}"


def read_remote(document: Document, source: RemoteSource | None, problems: Problems) -> RemoteSetup:
    """Return the remote control section of the rig file; problems are noted in ``problems``."""
    if source is None:
        return RemoteSetup()
    for index, endpoint in enumerate(source.listen):
        _check_endpoint(document, index, endpoint, source.tls is not None, problems)
    if source.tls is not None and not source.roles:
        problems.add(
            document.key_place(("remote", "tls")),
            "no client could connect: with TLS, a client needs a role",
            "add 'roles: {NAME: operator}', by the names in the certificates",
        )
    tls = None if source.tls is None else _files(source.tls, document.path.parent)
    return RemoteSetup(tuple(source.listen), tls, dict(source.roles))


def _files(source: TlsSource, folder: Path) -> TlsFiles:
    # The daemon checks whether the files exist: a rig file is checked on other machines too.
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
        problems.add(place, f"{endpoint} would admit clients without a certificate",
                     f"write tls{endpoint[3:]}")  # fmt: skip
    elif not has_tls and read.protocol == "tls":
        problems.add(place, f"{endpoint} needs certificates",
                     "add 'tls: {ca: ..., certificate: ..., key: ...}'; "
                     "rigd remote setup-tls makes them")  # fmt: skip
    elif not has_tls and not _is_loopback(read.host):
        problems.add(
            place, f"every client on the network can reach {endpoint} without a certificate",
            "listen on tcp/127.0.0.1 only, or add 'tls: ...' and write "
            f"tls{endpoint[3:]}; rigd remote setup-tls makes the certificates",
        )  # fmt: skip


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False  # the meaning of a name, even of localhost, depends on the resolver
