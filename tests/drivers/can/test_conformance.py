"""The CAN drivers keep the promises of the SDK, on simulated nodes behind a real socket."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest
from support.can.bench_sim import can_peer

from rigd.sdk.check import check_driver
from rigd_drivers.can.cia402_servo.current import CurrentServo
from rigd_drivers.can.cia402_servo.rotary import RotaryServo
from rigd_drivers.can.cia402_servo.speed import SpeedServo
from rigd_drivers.can.cia404_transmitter import Cia404Transmitter
from rigd_drivers.can.cia406_encoder import Cia406Encoder

#: Longer than a stall of a busy machine, which drives with the usual 100 ms would report.
WATCHDOG = "300 ms"


@pytest.mark.parametrize(
    ("driver", "kind", "options"),
    [
        (
            CurrentServo,
            "current",
            {
                "node": 1,
                "counts_per_revolution": "4096 count/rev",
                "current_range": "2 A",
                "watchdog": WATCHDOG,
                "rated_current": "1.5 A",
                "inverted": False,
            },
        ),
        (
            SpeedServo,
            "speed",
            {
                "node": 2,
                "counts_per_revolution": "4096 count/rev",
                "speed_range": "2 m/s",
                "watchdog": WATCHDOG,
                "travel": "100 mm/rev",
                "clutch": True,
                "inverted": False,
            },
        ),
        (
            RotaryServo,
            "rotary",
            {
                "node": 3,
                "counts_per_revolution": "4096 count/rev",
                "speed_range": "100 rad/s",
                "watchdog": WATCHDOG,
                "rated_torque": "1 N m",
                "gear_ratio": "1",
                "inverted": False,
            },
        ),
        (Cia406Encoder, "encoder", {"node": 11, "kind": "rotary"}),
        (
            Cia404Transmitter,
            "transmitter",
            {"node": 21, "unit": "5 N", "low": "-1500 N", "high": "1500 N"},
        ),
    ],
)
def test_can_drivers_work_as_drivers_do(
    driver: type[Any], kind: str, options: dict[str, Any]
) -> None:
    report = check_driver(driver, options, peer=partial(can_peer, kind))
    # A CiA 402 drive counts no frames, and takes setpoints without an answer.
    assert report.skipped.keys() <= {"frozen", "refused", "another at open"}
