"""Checks the certificates of one end of a connection and explains problems.

If TLS refuses a client, the client gets no reason. If no client trusts the certificate of a daemon,
the daemon gets no notice of it. The files at one end show most reasons.
"""

from __future__ import annotations

import socket
import ssl
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.types import PrivateKeyTypes, PublicKeyTypes
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    PublicFormat,
    load_pem_private_key,
)

from rigd.config.remote import Endpoint, TlsFiles
from rigd.model.errors import ConfigError

#: A notice appears so long before a certificate expires.
SOON: Final = timedelta(days=30)
#: How long a daemon may take to show its certificate, in s.
_SHOWN_S: Final = 2.0
#: The hint for a certificate that has expired.
RENEW: Final = (
    "in the folder with ca.key, remove it and its key; rigd remote setup-tls then makes another "
    "of the same authority"
)
#: The hint if a file cannot be read.
MISSING: Final = "rigd remote setup-tls makes it; the user of rigd must be allowed to read it"


def check_usable(files: TlsFiles, now: datetime | None = None) -> None:
    """Check that ``files`` can be read, are valid now and belong together.

    Raises:
        ConfigError: no peer could accept them; names the file and the remedy.
    """
    now = now or datetime.now(UTC)
    for path in (files.certificate, files.ca):
        _check_valid(path, _read(path), now)
    key = _read_key(files.key)
    if _encoded(key.public_key()) != _encoded(_read(files.certificate).public_key()):
        raise ConfigError(f"{files.key} is not the key of {files.certificate}")


def _check_valid(path: Path, certificate: x509.Certificate, now: datetime) -> None:
    since, until = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if now > until:
        raise ConfigError(f"{path} expired on {until:%Y-%m-%d}", hint=RENEW)
    if now < since:
        raise ConfigError(
            f"{path} is valid from {since:%Y-%m-%d %H:%M} UTC on, now it is {now:%Y-%m-%d %H:%M}",
            hint="is the clock of this computer right?",
        )


def distrusted(files: TlsFiles) -> str | None:
    """Return that the authority has not signed the certificate, or None."""
    try:
        _read(files.certificate).verify_directly_issued_by(_read(files.ca))
    except (InvalidSignature, ValueError, TypeError):
        return f"{files.certificate} is not signed by {files.ca}: are they of the same lab?"
    return None


def end_of(path: Path) -> datetime:
    """Return when a certificate expires, UTC.

    Raises:
        ConfigError: it cannot be read.
    """
    return _read(path).not_valid_after_utc


def refused_daemon(endpoint: str, files: TlsFiles) -> str | None:
    """Return why this end refuses the certificate that the daemon at ``endpoint`` shows, or None.

    Connects once, and blocks while it does.
    """
    place = Endpoint.read(endpoint)
    if place is None:
        return None
    trusting = ssl.create_default_context(cafile=str(files.ca))
    blind = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    blind.check_hostname, blind.verify_mode = False, ssl.CERT_NONE
    try:
        _shown(place, trusting)
    except ssl.SSLCertVerificationError as error:
        with suppress(OSError, ValueError):
            shown = x509.load_der_x509_certificate(_shown(place, blind))
            until = shown.not_valid_after_utc
            if until < datetime.now(UTC):
                return f"the certificate of the daemon expired on {until:%Y-%m-%d}; {RENEW}"
        return (
            f"the certificate of the daemon is refused: {error.verify_message}; is it of the lab "
            f"of {files.ca}, and made for the name in the address?"
        )
    except (OSError, ValueError):  # it does not let this client in: its reason is another
        pass
    return None


def _shown(place: Endpoint, context: ssl.SSLContext) -> bytes:
    """Return the certificate that a server shows (DER)."""
    with (
        socket.create_connection((place.host, place.port), _SHOWN_S) as plain,
        context.wrap_socket(plain, server_hostname=place.host) as secure,
    ):
        return secure.getpeercert(binary_form=True) or b""


def _read(path: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}", hint=MISSING) from error
    except ValueError as error:
        raise ConfigError(f"{path} is no certificate in PEM") from error


def _read_key(path: Path) -> PrivateKeyTypes:
    try:
        return load_pem_private_key(path.read_bytes(), None)
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}", hint=MISSING) from error
    except (ValueError, TypeError) as error:
        raise ConfigError(f"{path} is no key in PEM without a password") from error


def _encoded(key: PublicKeyTypes) -> bytes:
    return key.public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
