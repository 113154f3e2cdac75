"""The doctor says until when the certificates of a rig can be used."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from rigd.config.loader import load_rig
from rigd.config.remote import RemoteSetup
from rigd.config.rig import RigConfig
from rigd.daemon.doctor.certificates import examine_certificates
from rigd.daemon.doctor.check import CheckVerdict
from rigd.remote.certificates import SOON
from rigd.remote.tls import SERVER, VALID, files_of, setup_tls

NOW = datetime(2026, 11, 21, 12, tzinfo=UTC)


@pytest.fixture
def rig(tmp_path: Path) -> RigConfig:
    setup_tls(tmp_path, ["localhost"], ["alice"], now=NOW)
    setup = RemoteSetup(("tls/127.0.0.1:1",), files_of(tmp_path, SERVER), {"alice": "operator"})
    return replace(load_rig("lugre-1"), remote=setup)


@pytest.mark.parametrize(
    ("left", "verdict", "found"),
    [
        (SOON + timedelta(days=1, hours=1), CheckVerdict.OK, "rigd.crt expires first, in 31 days"),
        (timedelta(days=3, hours=1), CheckVerdict.WARN, "rigd.crt expires first, in 3 days"),
        (-timedelta(hours=1), CheckVerdict.FAIL, "rigd.crt expired on 2028-11-20"),
    ],
)
def test_doctor_counts_the_days(
    rig: RigConfig, left: timedelta, verdict: CheckVerdict, found: str
) -> None:
    (check,) = examine_certificates(rig, NOW + VALID - left)
    assert check.verdict is verdict
    assert found in check.found
    assert bool(check.advice) == (verdict is not CheckVerdict.OK)


def test_rig_without_certificates_needs_no_check() -> None:
    assert list(examine_certificates(load_rig("lugre-1"), NOW)) == []
