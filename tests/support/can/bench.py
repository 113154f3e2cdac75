"""The drivers of CAN devices as the tests of them need them, and a clock put forward by hand."""

from __future__ import annotations

import time
from collections.abc import Callable

from support.can.script import ScriptedBus, number, servo

from rigd_drivers.can.bus import CanBus
from rigd_drivers.can.cia402_servo.current import CurrentServo, CurrentServoConfig
from rigd_drivers.can.cia402_servo.speed import SpeedServo, SpeedServoConfig
from rigd_drivers.can.cia406_encoder import Cia406Encoder, EncoderConfig

Connect = Callable[..., tuple[CanBus, ScriptedBus]]

ENABLED = 0x1237  # operation enabled, voltage, remote, follows
OFF = 0x0250


class Clock:
    """CLOCK_MONOTONIC, put forward by hand."""

    def __init__(self) -> None:
        self.ahead_ns = 0
        self._real = time.monotonic_ns

    def __call__(self) -> int:
        return self._real() + self.ahead_ns

    def stand(self) -> None:
        """Go on by :meth:`pass_by` alone: what stalls takes no time."""
        now_ns = self._real()
        self._real = lambda: now_ns

    def pass_by(self, seconds: float) -> None:
        self.ahead_ns += round(seconds * 1e9)


def wheel_config(**options: object) -> CurrentServoConfig:
    given = {
        "node": 1,
        "counts_per_revolution": "1024 count/rev",
        "current_range": "2 A",
        **options,
    }
    return CurrentServoConfig.model_validate(given)


def wheel(bus: CanBus, **options: object) -> CurrentServo:
    return CurrentServo(wheel_config(**options), bus)


def belt_config(**options: object) -> SpeedServoConfig:
    given = {
        "node": 2,
        "counts_per_revolution": "4096 count/rev",
        "speed_range": "2.5 m/s",
        "travel": "100 mm/rev",
        "clutch": True,
        **options,
    }
    return SpeedServoConfig.model_validate(given)


def belt(bus: CanBus, **options: object) -> SpeedServo:
    return SpeedServo(belt_config(**options), bus)


def encoder_config(**options: object) -> EncoderConfig:
    return EncoderConfig.model_validate({"node": 11, "kind": "rotary", **options})


def encoder(bus: CanBus, **options: object) -> Cia406Encoder:
    return Cia406Encoder(encoder_config(**options), bus)


def feedback(port: ScriptedBus, status: int, torque: int = 0, counts: int = 0) -> None:
    port.say(0x181, number(status, 2) + number(torque, 2) + number(counts, 4))


def cycle(
    driver: CurrentServo | SpeedServo, port: ScriptedBus, *setpoints: float
) -> list[tuple[int, str]]:
    """One cycle; what was sent in it, but for heartbeats."""
    first = len(port.sent)
    driver.link.begin(0)
    driver.read(0)
    driver.write(setpoints)
    driver.link.end(0)
    return [(to, data.hex(" ")) for to, data in port.sent[first:] if to != 0x77F]


def enabled(connect: Connect, **options: object) -> tuple[CurrentServo, ScriptedBus]:
    """A wheel that is armed and enabled."""
    bus, port = connect(servo())
    driver = wheel(bus, **options)
    driver.open()
    cycle(driver, port, 0.0)
    driver.arm()
    for status in (OFF, 0x0231, 0x0233, ENABLED):
        feedback(port, status)
        cycle(driver, port, 0.0)
    assert driver.ready()
    return driver, port
