"""Certificates that expire are told days ahead, once a day, and at the moment itself."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from rigd.config.remote import RemoteSetup
from rigd.daemon.serve.upkeep.certificates import CertificateWatch
from rigd.remote.certificates import SOON
from rigd.remote.tls import SERVER, VALID, files_of, setup_tls

NOW = datetime(2026, 11, 21, 12, tzinfo=UTC)
END = NOW + VALID


class Lab:
    """A daemon with certificates, and a clock that stands until it is moved."""

    def __init__(self, folder: Path) -> None:
        setup_tls(folder, ["localhost"], ["alice"], now=NOW)
        self.now = NOW
        self.told: list[str] = []
        setup = RemoteSetup(
            ("tls/127.0.0.1:1",), files_of(folder, SERVER), {"alice": "operator", "bob": "observer"}
        )
        self.watch = CertificateWatch(
            setup, lambda text, level: self.told.append(f"{level}: {text}"), lambda: self.now
        )

    def at(self, now: datetime) -> list[str]:
        """Return what is told then."""
        self.now, self.told[:] = now, []
        self.watch.tend()
        return list(self.told)

    def shown(self) -> list[tuple[str, str]]:
        return [(item.whose, item.name) for item in self.watch.views()]


@pytest.fixture
def lab(tmp_path: Path) -> Lab:
    return Lab(tmp_path)


def test_daemon_tells_days_ahead_once_a_day(lab: Lab) -> None:
    assert lab.at(END - SOON - timedelta(hours=2)) == []
    assert lab.shown() == []
    (said,) = lab.at(END - timedelta(days=7))
    assert said.startswith(
        "warning: the daemon's rigd.crt expires on 2028-11-20, in 7 days: no client"
    )
    assert "/" not in said.partition(";")[0]  # observers see it
    assert lab.shown() == [("daemon", "rigd.crt")]
    assert lab.at(END - timedelta(days=7) + timedelta(hours=2)) == []
    assert "in 6 days" in lab.at(END - timedelta(days=6))[0]


def test_expiry_is_told_at_its_moment(lab: Lab) -> None:
    assert lab.at(END - timedelta(minutes=1))
    assert lab.at(END - timedelta(seconds=1)) == []
    (said,) = lab.at(END + timedelta(seconds=1))
    assert said.startswith(
        "error: the daemon's rigd.crt expired on 2028-11-20: no client can connect"
    )


def test_client_is_named_as_its_requests_say(lab: Lab) -> None:
    until = END - timedelta(days=100)
    until_ns = round(until.timestamp()) * 10**9
    lab.watch.seen("alice", until_ns)
    lab.watch.seen("mallory", until_ns)  # has no role
    lab.watch.seen("bob", 0)
    (said,) = lab.at(until - timedelta(days=3))
    assert "the certificate of alice expires on" in said
    assert [(item.name, item.until_ns) for item in lab.watch.views()] == [("alice", until_ns)]
    assert lab.watch.expired("alice") == ""
    assert "alice expired" in lab.at(until + timedelta(seconds=1))[0]
    assert lab.watch.expired("alice") == f"its certificate expired on {until:%Y-%m-%d}"


def test_certificate_that_cannot_be_read_is_told(lab: Lab, tmp_path: Path) -> None:
    (tmp_path / "rigd.crt").unlink()
    (said,) = lab.at(NOW)
    assert "rigd.crt cannot be read" in said


def test_rig_without_certificates_has_none_to_tell() -> None:
    watch = CertificateWatch(RemoteSetup(), lambda *_: pytest.fail("told"))
    watch.seen("alice", 1)
    watch.tend()
    assert watch.views() == ()
