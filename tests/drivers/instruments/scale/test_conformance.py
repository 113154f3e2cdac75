"""The driver keeps the promises of the SDK; KERN KCP is MT-SICS with a pause."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from support.instruments.serial_peer import serial_peer

from rigd.sdk.check import check_driver
from rigd_drivers.instruments.scale.driver import SerialScale
from rigd_sim.wire.instruments.scale import SimScale


@pytest.mark.parametrize("dialect", ["mt-sics", "and-d"])
def test_it_keeps_what_a_slow_driver_promises(dialect: Any, tmp_path: Path) -> None:
    def scale() -> SimScale:
        return SimScale("scale", path, lambda: 0.0, dialect=dialect, settling_s=0.02)

    path = tmp_path / "scale"
    report = check_driver(SerialScale, {"dialect": dialect}, peer=serial_peer(path, scale))
    assert report.skipped.keys() == {"action refused", "another at open"}
