"""What is wrong with certificates is reported by the end that has them."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import pytest

from rigd.config.remote import RemoteSetup, TlsFiles
from rigd.model import ConfigError, LinkError
from rigd.remote import Client
from rigd.remote.certificates import SOON, check_usable, distrusted, expires_soon
from rigd.remote.server import Lease, Server
from rigd.remote.tls import CA_VALID, SERVER, VALID, files_of, setup_tls

NOW = datetime(2026, 11, 21, 12, tzinfo=UTC)  # for what is asked about a day, not about today


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    setup_tls(tmp_path, ["localhost"], ["alice", "bob"], now=NOW)
    return tmp_path


def test_generated_certificates_have_no_problem(folder: Path) -> None:
    for name in (SERVER, "alice"):
        files = files_of(folder, name)
        check_usable(files, NOW)
        assert distrusted(files) is None
        assert expires_soon(files, NOW) is None


@pytest.mark.parametrize(
    ("after", "message"),
    [
        (VALID + timedelta(minutes=1), r"alice\.crt expired on 2028-11-20"),
        (CA_VALID + timedelta(minutes=1), r"alice\.crt expired"),
        (-timedelta(hours=2), r"alice\.crt is valid from 2026-11-21 11:00 UTC on"),
    ],
)
def test_certificate_not_valid_now_is_refused(folder: Path, after: timedelta, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        check_usable(files_of(folder, "alice"), NOW + after)


def spoilt(folder: Path) -> None:
    (folder / "alice.crt").write_text("no certificate")


def lost(folder: Path) -> None:
    (folder / "alice.key").unlink()


def of_bob(folder: Path) -> None:
    (folder / "alice.key").write_bytes((folder / "bob.key").read_bytes())


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (spoilt, r"alice\.crt is no certificate in PEM"),
        (lost, r"alice\.key cannot be read: No such file"),
        (of_bob, r"alice\.key is not the key of .*alice\.crt"),
    ],
)
def test_files_that_do_not_serve(folder: Path, spoil: Callable[[Path], None], message: str) -> None:
    spoil(folder)
    with pytest.raises(ConfigError, match=message):
        check_usable(files_of(folder, "alice"), NOW)


def test_certificate_of_another_lab_is_distrusted(
    folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    other = tmp_path_factory.mktemp("other")
    setup_tls(other, ["localhost"], ["alice"], now=NOW)
    alice = files_of(folder, "alice")
    mixed = TlsFiles(other / "ca.crt", alice.certificate, alice.key)
    check_usable(mixed, NOW)
    assert re.search(r"alice\.crt is not signed by .*ca\.crt", distrusted(mixed) or "")


def test_certificate_that_expires_soon_is_reported(folder: Path) -> None:
    server, end = files_of(folder, SERVER), NOW + VALID
    assert expires_soon(server, end - SOON - timedelta(days=1)) is None
    assert "rigd.crt expires on 2028-11-20" in str(expires_soon(server, end - SOON))


def made_two_days_ago(folder: Path) -> date:
    """Make certificates that were valid for a day; return the day on which they expired."""
    made = datetime.now(UTC) - timedelta(days=2)
    setup_tls(folder, ["localhost"], ["alice"], now=made, valid=timedelta(days=1))
    return (made + timedelta(days=1)).date()


def test_daemon_with_expired_certificate_does_not_serve(tmp_path: Path) -> None:
    expired = made_two_days_ago(tmp_path)
    setup = RemoteSetup(("tls/127.0.0.1:1",), files_of(tmp_path, SERVER), {"alice": "operator"})
    with pytest.raises(ConfigError, match=rf"rigd\.crt expired on {expired}") as caught:
        Server("lugre-1", setup, Lease())
    assert "setup-tls" in str(caught.value.hint)


def test_refused_client_learns_the_fault_of_its_certificate(tmp_path: Path) -> None:
    expired = made_two_days_ago(tmp_path)
    with pytest.raises(LinkError, match="no daemon admits this client") as caught:
        Client("lugre-1", endpoint="tls/127.0.0.1:1", tls=files_of(tmp_path, "alice"))
    assert f"alice.crt expired on {expired}" in str(caught.value.hint)
