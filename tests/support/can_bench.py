"""The drivers of CAN devices as the tests of them need them, and a clock put forward by hand."""

from __future__ import annotations

import math
import time

from rigd_drivers.can_bus import CanBus
from rigd_drivers.cia402_servo.current import CurrentServo, CurrentServoConfig
from rigd_drivers.cia402_servo.speed import SpeedServo, SpeedServoConfig
from rigd_drivers.cia406_encoder import Cia406Encoder, EncoderConfig

RADIANS_PER_COUNT = 2 * math.pi / 1024


class Clock:
    """CLOCK_MONOTONIC, put forward by hand."""

    def __init__(self) -> None:
        self.ahead_ns = 0
        self._real = time.monotonic_ns

    def __call__(self) -> int:
        return self._real() + self.ahead_ns

    def pass_by(self, seconds: float) -> None:
        self.ahead_ns += round(seconds * 1e9)


def wheel(bus: CanBus | None, **options: object) -> CurrentServo:
    given = {
        "node": 1,
        "counts_per_revolution": "1024 count/rev",
        "current_range": "2 A",
        **options,
    }
    return CurrentServo(CurrentServoConfig.model_validate(given), bus)


def belt(bus: CanBus | None, **options: object) -> SpeedServo:
    given = {
        "node": 2,
        "counts_per_revolution": "4096 count/rev",
        "speed_range": "2.5 m/s",
        "travel": "100 mm/rev",
        "clutch": True,
        **options,
    }
    return SpeedServo(SpeedServoConfig.model_validate(given), bus)


def encoder(bus: CanBus | None, **options: object) -> Cia406Encoder:
    given = {"node": 11, "kind": "rotary", **options}
    return Cia406Encoder(EncoderConfig.model_validate(given), bus)
