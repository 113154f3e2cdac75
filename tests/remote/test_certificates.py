"""What is wrong with certificates is reported by the end that has them."""

from __future__ import annotations

import re
import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import pytest
from support.daemon.served_rig import free_port, serve

from rigd.config.remote import RemoteSetup, TlsFiles
from rigd.model import ConfigError, LinkError
from rigd.remote import Client
from rigd.remote.certificates import check_usable, distrusted, end_of
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


def test_client_with_expired_certificate_is_told_date(tmp_path: Path) -> None:
    setup_tls(tmp_path, ["localhost", "127.0.0.1"], [])
    expired = made_two_days_ago(tmp_path)  # alice's: the daemon's is there already
    setup = RemoteSetup(
        (f"tls/127.0.0.1:{free_port()}",), files_of(tmp_path, SERVER), {"alice": "operator"}
    )
    with serve(setup) as served, pytest.raises(LinkError, match="no daemon admits") as caught:
        Client("lugre-1", endpoint=served.endpoint, tls=files_of(tmp_path, "alice"))
    assert re.search(
        rf"your certificate: .*alice\.crt expired on {expired}", str(caught.value.hint)
    )
    assert "setup-tls" in str(caught.value.hint)


@contextmanager
def another_server(files: TlsFiles) -> Iterator[int]:
    """Shake hands on the port given, by the TLS of Python."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(files.certificate, files.key)
    ended = threading.Event()

    def accept() -> None:
        while not ended.is_set():
            with suppress(OSError):
                plain, _ = listening.accept()
                with plain, context.wrap_socket(plain, server_side=True) as secure:
                    secure.recv(1)

    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = threading.Thread(target=accept)
        thread.start()
        try:
            port: int = listening.getsockname()[1]
            yield port
        finally:
            ended.set()
            with suppress(OSError):
                socket.create_connection(("127.0.0.1", port)).close()
            thread.join()


@pytest.mark.parametrize("spoil", ["expired", "foreign"])
def test_client_names_fault_of_daemon_certificate(tmp_path: Path, spoil: str) -> None:
    lab = tmp_path / "lab"
    if spoil == "expired":
        expired = made_two_days_ago(lab)
        (lab / "alice.crt").unlink()
        (lab / "alice.key").unlink()
        expected = f"the certificate of the daemon expired on {expired}"
    else:
        setup_tls(tmp_path / "other", ["localhost"], [])
        expected = "the certificate of the daemon is refused: "
    setup_tls(lab, ["localhost"], ["alice"])
    shown = files_of(tmp_path / "other" if spoil == "foreign" else lab, SERVER)
    with another_server(shown) as port, pytest.raises(LinkError) as caught:
        Client("lugre-1", endpoint=f"tls/localhost:{port}", tls=files_of(lab, "alice"))
    assert expected in str(caught.value.hint)


def test_daemon_learns_when_certificate_of_client_expires(tmp_path: Path) -> None:
    setup_tls(tmp_path, ["localhost", "127.0.0.1"], ["alice"], valid=timedelta(days=20))
    setup = RemoteSetup(
        (f"tls/127.0.0.1:{free_port()}",), files_of(tmp_path, SERVER), {"alice": "operator"}
    )
    with serve(setup) as served:
        with Client("lugre-1", endpoint=served.endpoint, tls=files_of(tmp_path, "alice")) as client:
            client.latest()
        until_ns = served.rig.requests[-1].requester.certificate_until_ns
    assert until_ns == round(end_of(tmp_path / "alice.crt").timestamp()) * 10**9
