"""Certificates: their content, the readers of the keys, and that none is overwritten."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from rigd.config.remote import HERE
from rigd.model import ConfigError
from rigd.remote.protocol import Refusal
from rigd.remote.tls import VALID, setup_tls

HOSTS = ["rig.lab", "192.168.1.5", "::1"]
NOW = datetime(2026, 11, 21, tzinfo=UTC)


def read(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    setup_tls(tmp_path / "certs", HOSTS, ["alice", "bob"], now=NOW)
    return tmp_path / "certs"


def test_everything_that_is_needed_is_made(tmp_path: Path) -> None:
    made = setup_tls(tmp_path, HOSTS, ["alice"])
    names = ["ca.crt", "ca.key", "rigd.crt", "rigd.key", "alice.crt", "alice.key"]
    assert [path.name for path in made.files] == names
    assert {path.name for path in tmp_path.iterdir()} == set(names)
    assert made.kept == ()


def test_each_is_signed_by_the_authority(folder: Path) -> None:
    authority = read(folder / "ca.crt")
    for name in ("ca", "rigd", "alice", "bob"):
        read(folder / f"{name}.crt").verify_directly_issued_by(authority)


@pytest.mark.parametrize(
    ("name", "usage"),
    [("rigd", ExtendedKeyUsageOID.SERVER_AUTH), ("alice", ExtendedKeyUsageOID.CLIENT_AUTH)],
)
def test_certificate_has_a_single_use(
    folder: Path, name: str, usage: x509.ObjectIdentifier
) -> None:
    extensions = read(folder / f"{name}.crt").extensions
    assert list(extensions.get_extension_for_class(x509.ExtendedKeyUsage).value) == [usage]
    constraints = extensions.get_extension_for_class(x509.BasicConstraints)
    assert constraints.critical
    assert not constraints.value.ca


def test_the_authority_signs_certificates_and_no_other_authority(folder: Path) -> None:
    extensions = read(folder / "ca.crt").extensions
    constraints = extensions.get_extension_for_class(x509.BasicConstraints).value
    assert (constraints.ca, constraints.path_length) == (True, 0)


def test_a_client_is_known_by_its_common_name(folder: Path) -> None:
    subject = read(folder / "alice.crt").subject
    assert [item.value for item in subject.get_attributes_for_oid(NameOID.COMMON_NAME)] == ["alice"]


def test_server_is_known_by_its_names_and_addresses(folder: Path) -> None:
    names = read(folder / "rigd.crt").extensions.get_extension_for_class(
        x509.SubjectAlternativeName
    )
    found = [str(item.value) for item in names.value]
    assert found == [*HOSTS, HERE]  # the last for the panel on its own machine


def test_certificates_end_after_their_validity(folder: Path) -> None:
    assert read(folder / "alice.crt").not_valid_after_utc == NOW + VALID


def test_keys_are_for_their_owner_only(folder: Path) -> None:
    for path in folder.glob("*.key"):
        assert path.stat().st_mode & 0o777 == 0o600


def test_clients_are_added_without_overwriting_anything(folder: Path) -> None:
    before = {path: path.read_bytes() for path in folder.iterdir()}
    made = setup_tls(folder, HOSTS, ["alice", "carol"])
    assert [path.name for path in made.files] == ["carol.crt", "carol.key"]
    assert {path.name for path in made.kept} >= {"ca.crt", "rigd.crt", "alice.crt"}
    assert {path: path.read_bytes() for path in before} == before
    read(folder / "carol.crt").verify_directly_issued_by(read(folder / "ca.crt"))


@pytest.mark.parametrize("name", ["a/b", "../x", "", "a b"])
def test_name_not_allowed_in_keys_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(Refusal):
        setup_tls(tmp_path / "certs", HOSTS, [name])
    assert not (tmp_path / "certs").exists()


@pytest.mark.parametrize("name", ["ca", "rigd"])
def test_client_cannot_take_files_of_rig(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="cannot be named"):
        setup_tls(tmp_path, HOSTS, [name])


@pytest.mark.parametrize(
    "host", ["", "a b", "rig lab", "*.lab", "-x", "rig..lab", "bänk", "1.2.3.4:5"]
)
def test_invalid_host_is_refused_before_anything_is_made(tmp_path: Path, host: str) -> None:
    with pytest.raises(ConfigError, match="no name or address"):
        setup_tls(tmp_path / "certs", [host], [])
    assert not (tmp_path / "certs").exists()


def test_a_server_needs_a_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="without a name"):
        setup_tls(tmp_path, [], ["alice"])


def test_certificate_without_its_key_is_refused(folder: Path) -> None:
    (folder / "rigd.key").unlink()
    with pytest.raises(ConfigError, match="without the other file of its pair"):
        setup_tls(folder, HOSTS, [])


def test_a_certificate_made_in_the_past_has_ended(tmp_path: Path) -> None:
    setup_tls(tmp_path, HOSTS, ["alice"], valid=timedelta(days=1), now=NOW)
    assert read(tmp_path / "alice.crt").not_valid_after_utc == NOW + timedelta(days=1)
