"""Determines the address of a daemon and the identity of the client that connects to it."""

from __future__ import annotations

import getpass
import json
import re
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Final

from rigd import __version__
from rigd.config.problems import suggest
from rigd.config.remote import DEFAULT_ENDPOINT, Endpoint, TlsFiles
from rigd.model.errors import ConfigError
from rigd.remote.client.rigs.address import Remote, list_path, rigd_folder
from rigd.remote.protocol.keys import check_name
from rigd.remote.protocol.limits import MAX_NAME

#: A list that was changed so short a time ago may change again within one tick of its times, in ns.
_SETTLED_NS: Final = 2_000_000_000
_NOT_IN_NAMES: Final = re.compile(r"[^A-Za-z0-9._-]+")


@dataclass(frozen=True)
class Target:
    """Address of a daemon and credentials of a client; made by :func:`make_target`."""

    rig: str | None
    """None: the only rig at that address."""
    endpoint: str
    tls: TlsFiles | None
    identity: str
    """The name under which the daemon knows the client."""
    certificate_until_ns: int = 0
    """When its certificate expires, in ns since the Unix epoch; 0 without one."""
    note: str = ""
    """Why this address was tried; for the error if no rig is found."""


def _cache_path() -> Path:
    return rigd_folder("XDG_CACHE_HOME", ".cache") / "remotes.json"


def make_target(
    rig: str | None = None,
    endpoint: str = DEFAULT_ENDPOINT,
    tls: TlsFiles | None = None,
    identity: str | None = None,
) -> Target:
    """Return a target whose parts are consistent.

    Without ``identity`` a client has the name in its certificate or, on loopback, that of the user
    of this process; there a name identifies a client, and proves nothing.

    Raises:
        ConfigError: the address is invalid, or certificates are missing or unusable.
        Refusal: a name is not allowed in a key.
    """
    read = Endpoint.read(endpoint)
    if read is None:
        raise ConfigError(
            f"{endpoint!r} is not the address of a daemon",
            hint="such as tcp/127.0.0.1:7447 or, with certificates, tls/rig.lab:7447",
        )
    if read.protocol == "tls" and tls is None:
        raise ConfigError(
            f"{endpoint} needs certificates",
            hint="ca.crt, and NAME.crt and NAME.key of your own: rigd remote setup-tls makes them",
        )
    if read.protocol == "tcp" and tls is not None:
        raise ConfigError(
            f"{endpoint} would send everything unencrypted, and use no certificate",
            hint=f"write tls{endpoint[3:]}",
        )
    if rig is not None:
        check_name(rig, "rig name")
    until_ns = 0
    if tls is not None:
        identity, until_ns = _certified(tls, identity)
    name = check_name(identity or _user(), "name of the client")
    return Target(rig, endpoint, tls, name, until_ns)


def find_target(
    rig: str | None = None,
    endpoint: str | None = None,
    tls: TlsFiles | None = None,
    identity: str | None = None,
) -> Target:
    """Return the target for ``rig``: from the list, with the values given here in place of its own.

    Without a name it is the only rig of the list or, if that is empty, the only rig on this
    machine.

    Raises:
        ConfigError: the list or an argument is wrong, or it has several rigs and none is named.
        Refusal: a name is not allowed in a key.
    """
    if endpoint is not None:
        return make_target(rig, endpoint, tls, identity)
    known = _known()
    if rig is None and len(known) > 1:
        raise ConfigError(
            f"which rig? {list_path()} has {', '.join(sorted(known))}", hint="name one (--rig NAME)"
        )
    if rig is None and known:
        rig = next(iter(known))
    found = Remote() if rig is None else known.get(rig, Remote())
    target = make_target(rig, found.endpoint, tls or found.tls, identity or found.identity)
    if rig is None or rig in known or not known:
        return target
    unknown = f"{rig} is not in {list_path()} ({suggest(rig, known)})"
    return replace(target, note=f"{unknown}, so rigd looked for it on this machine; ")


def _known() -> Mapping[str, Remote]:
    """Return the list; what was read of this very file before is not read again.

    So a stop does not wait for the reader of YAML to be imported.

    Raises:
        ConfigError: the list is wrong.
    """
    path = list_path()
    try:
        state = path.stat()
    except FileNotFoundError:
        return {}
    made = [
        __version__,
        str(path),
        state.st_ino,
        state.st_size,
        state.st_mtime_ns,
        state.st_ctime_ns,
    ]
    kept = _cache_path()
    with suppress(OSError, ValueError, KeyError, TypeError):
        known = json.loads(kept.read_bytes())
        if known["made"] == made:
            return {name: Remote.of(line) for name, line in known["remotes"].items()}
    from rigd.remote.client.rigs.remotes import read_remotes

    found = read_remotes()
    if time.time_ns() - state.st_ctime_ns > _SETTLED_NS:
        with suppress(OSError):
            _keep(
                kept,
                {"made": made, "remotes": {name: asdict(line) for name, line in found.items()}},
            )
    return found


def _keep(path: Path, known: Mapping[str, object]) -> None:
    """Write a file for this user alone, whole or not at all."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    with NamedTemporaryFile("w", dir=path.parent, delete=False) as file:
        json.dump(known, file, default=str)
    Path(file.name).replace(path)


def name_and_end_in(certificate: Path) -> tuple[str, int]:
    """Return the common name in a certificate (PEM), and its end in ns since the Unix epoch.

    The rig file gives a role to the name.

    Raises:
        ConfigError: it cannot be read, or has none.
    """
    from cryptography import x509
    from cryptography.x509.oid import NameOID

    try:
        read = x509.load_pem_x509_certificate(certificate.read_bytes())
    except (OSError, ValueError) as error:
        raise ConfigError(f"{certificate} is no certificate in PEM: {error}") from error
    names = read.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    if len(names) != 1:
        raise ConfigError(f"{certificate} has {len(names)} common names, expected one")
    return str(names[0].value), round(read.not_valid_after_utc.timestamp()) * 10**9


def _certified(tls: TlsFiles, identity: str | None) -> tuple[str, int]:
    """Return the name in the certificate of a client, and when that expires."""
    for path in (tls.ca, tls.certificate, tls.key):
        if not path.is_file():
            raise ConfigError(
                f"there is no file {path}",
                hint="ask the person who ran rigd remote setup-tls for ca.crt, and for your own "
                "NAME.crt and NAME.key",
            )
    own, until_ns = name_and_end_in(tls.certificate)
    if identity not in (None, own):
        raise ConfigError(
            f"{tls.certificate} is the certificate of {own}, not of {identity}",
            hint="the name in the certificate is the one that counts",
        )
    return own, until_ns


def _user() -> str:
    """Return the name of the user of this process, as far as it is allowed in a key."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # a container may run under a user number without a name
        user = ""
    return _NOT_IN_NAMES.sub("-", user).strip("-")[:MAX_NAME] or "somebody"
