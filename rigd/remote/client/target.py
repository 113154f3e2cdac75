"""Determines the address of a daemon and the identity of the client that connects to it."""

from __future__ import annotations

import getpass
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.x509.oid import NameOID

from rigd.config.remote import DEFAULT_ENDPOINT, Endpoint, TlsFiles
from rigd.model.errors import ConfigError
from rigd.remote.protocol.keys import check_name
from rigd.remote.protocol.limits import MAX_NAME

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
    note: str = ""
    """Why this address was tried; for the error if no rig is found."""


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
    if tls is not None:
        identity = _certified(tls, identity)
    return Target(rig, endpoint, tls, check_name(identity or _user(), "name of the client"))


def name_in(certificate: Path) -> str:
    """Return the common name in a certificate (PEM), to which the rig file gives a role.

    Raises:
        ConfigError: it cannot be read, or has none.
    """
    try:
        read = x509.load_pem_x509_certificate(certificate.read_bytes())
    except (OSError, ValueError) as error:
        raise ConfigError(f"{certificate} is no certificate in PEM: {error}") from error
    names = read.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    if len(names) != 1:
        raise ConfigError(f"{certificate} has {len(names)} common names, expected one")
    return str(names[0].value)


def _certified(tls: TlsFiles, identity: str | None) -> str:
    for path in (tls.ca, tls.certificate, tls.key):
        if not path.is_file():
            raise ConfigError(
                f"there is no file {path}",
                hint="ask the person who ran rigd remote setup-tls for ca.crt, and for your own "
                "NAME.crt and NAME.key",
            )
    own = name_in(tls.certificate)
    if identity not in (None, own):
        raise ConfigError(
            f"{tls.certificate} is the certificate of {own}, not of {identity}",
            hint="the name in the certificate is the one that counts",
        )
    return own


def _user() -> str:
    """Return the name of the user of this process, as far as it is allowed in a key."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # a container may run under a user number without a name
        user = ""
    return _NOT_IN_NAMES.sub("-", user).strip("-")[:MAX_NAME] or "somebody"
