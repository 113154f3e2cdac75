"""Creates the TLS certificates of a lab: one for the authority, one per rig, one per client.

The name of a client is the common name of its certificate (RFC 5280). The rig file states what a
client of that name may do. Keys are ECDSA on P-256 in PKCS #8, which zenoh's TLS library (rustls)
reads. A server certificate cannot be used as a client certificate, and a client certificate cannot
be used as a server certificate (extended key usage, RFC 5280 section 4.2.1.12).
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from rigd.config.remote import HERE, TlsFiles
from rigd.model.errors import ConfigError
from rigd.model.machine.system import BINARY
from rigd.remote.protocol import check_name

#: How long the authority and the certificates are valid.
CA_VALID: Final = timedelta(days=3650)
VALID: Final = timedelta(days=730)
#: Clocks of a lab may differ by this much.
_SKEW: Final = timedelta(hours=1)

#: Labels of letters, digits and dashes (RFC 1123 section 2.1).
_HOST: Final = re.compile(r"(?!-)[A-Za-z0-9-]{1,63}(?:\.[A-Za-z0-9-]{1,63})*")

#: Names of the files of an authority and of a rig's server.
CA: Final = "ca"
SERVER: Final = "rigd"


@dataclass(frozen=True)
class Made:
    """The files that were written, and those that existed before."""

    files: tuple[Path, ...]
    kept: tuple[Path, ...]


def files_of(folder: Path, name: str) -> TlsFiles:
    """Return the files by which ``name`` (:data:`SERVER` or a client) proves itself."""
    return TlsFiles(folder / f"{CA}.crt", folder / f"{name}.crt", folder / f"{name}.key")


def setup_tls(
    folder: Path,
    hosts: Sequence[str],
    clients: Sequence[str],
    *,
    valid: timedelta = VALID,
    now: datetime | None = None,
) -> Made:
    """Make the missing files in ``folder``: the authority, the server for ``hosts``, the clients.

    ``hosts`` are the names and addresses by which clients reach the rig; :data:`HERE` is added.
    Existing files are never overwritten, so that more clients can be added later; a private key is
    readable by its owner only.

    Raises:
        Refusal: a client's name is not allowed in a key.
        ConfigError: a client has the name of the authority or the server; a host is invalid; or a
            certificate exists without its key, or a key without its certificate.
    """
    now = now or datetime.now(UTC)
    for name in clients:
        check_name(name, "client name")
        if name in (CA, SERVER):
            raise ConfigError(
                f"a client cannot be named {name!r}: the rig itself uses a file of this name"
            )
    reached_by = [_general_name(host) for host in dict.fromkeys([*hosts, HERE])]
    folder.mkdir(parents=True, exist_ok=True)
    made: list[Path] = []
    kept: list[Path] = []

    def missing(name: str) -> bool:
        pair = folder / f"{name}.crt", folder / f"{name}.key"
        there = [path for path in pair if path.exists()]
        if len(there) == 1:
            raise ConfigError(
                f"{there[0]} exists without the other file of its pair",
                hint=f"remove it, or restore {next(item for item in pair if item not in there)}",
            )
        (kept if there else made).extend(pair)
        return not there

    if missing(CA):
        _make_authority(folder, now)
    authority = _read_authority(folder)
    if missing(SERVER):
        if not hosts:
            raise ConfigError(
                "no client could trust a server without a name",
                hint="give the names or addresses by which clients reach the rig",
            )
        names = x509.SubjectAlternativeName(reached_by)
        _make(folder, SERVER, authority, ExtendedKeyUsageOID.SERVER_AUTH, names, now, valid)
    for name in clients:
        if missing(name):
            names = x509.SubjectAlternativeName([x509.DNSName(f"{name}.client.invalid")])
            _make(folder, name, authority, ExtendedKeyUsageOID.CLIENT_AUTH, names, now, valid)
    return Made(tuple(made), tuple(kept))


@dataclass(frozen=True)
class _Authority:
    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def _make_authority(folder: Path, now: datetime) -> None:
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _subject("rigd lab authority")
    certificate = (
        _builder(subject, subject, key, now, CA_VALID)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    _write(folder, CA, certificate, key)


def _read_authority(folder: Path) -> _Authority:
    key = serialization.load_pem_private_key((folder / f"{CA}.key").read_bytes(), None)
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise ConfigError(f"{folder / CA}.key is no ECDSA key, as rigd makes them")
    certificate = x509.load_pem_x509_certificate((folder / f"{CA}.crt").read_bytes())
    return _Authority(certificate, key)


def _make(
    folder: Path,
    name: str,
    authority: _Authority,
    usage: x509.ObjectIdentifier,
    alternative: x509.SubjectAlternativeName,
    now: datetime,
    valid: timedelta,
) -> None:
    key = ec.generate_private_key(ec.SECP256R1())
    issuer = authority.certificate.subject
    signer = authority.key.public_key()
    certificate = (
        _builder(_subject(name), issuer, key, now, valid)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([usage]), critical=False)
        .add_extension(alternative, critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(signer), critical=False)
        .sign(authority.key, hashes.SHA256())
    )
    _write(folder, name, certificate, key)


def _builder(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    now: datetime,
    valid: timedelta,
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _SKEW)
        .not_valid_after(now + valid)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _subject(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _usage(*, signs: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs,
        key_cert_sign=signs,
        crl_sign=signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        if _HOST.fullmatch(host) is None:
            raise ConfigError(
                f"{host!r} is no name or address of a computer", hint="such as rig.lab or 10.0.0.5"
            ) from None
        return x509.DNSName(host)


def _write(
    folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey
) -> None:
    secret = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    # Created with its mode, so that no other user can read the key even for a moment.
    file = os.open(folder / f"{name}.key", os.O_WRONLY | os.O_CREAT | os.O_EXCL | BINARY, 0o600)
    with os.fdopen(file, "wb") as out:
        out.write(secret)
    (folder / f"{name}.crt").write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
