"""The driver keeps the promises of the SDK, asked and unasked."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from support.instruments.serial_peer import serial_peer

from rigd.sdk.check import SentReading, check_driver
from rigd_drivers.instruments.lines.driver import Lines
from rigd_sim.wire.instruments.lines import SimLines


@pytest.mark.parametrize("asked", [True, False])
def test_it_keeps_what_a_slow_driver_promises(asked: bool, tmp_path: Path) -> None:
    options = {
        "pattern": r"(?P<force>-?\d+\.\d{3}) N",
        "channels": {"force": "N"},
        "silence": "1 s",
        **({"ask": r"?\r\n"} if asked else {"period": "0.1 s"}),
    }

    readings: list[SentReading] = []

    def force() -> dict[str, float]:
        readings.append(SentReading(time.monotonic(), {"force": len(readings) * 37 % 1000 / 1000}))
        return dict(readings[-1].values)

    def device() -> SimLines:
        return SimLines(
            "gauge", tmp_path / "gauge", force, "{force:.3f} N",
            ask="?" if asked else None, interval_s=0.05,
        )  # fmt: skip

    peer = serial_peer(tmp_path / "gauge", device, readings if asked else None, delay_s=1.0)
    report = check_driver(Lines, options, peer=peer)
    assert report.skipped.keys() == {"action refused", "another at open"}
