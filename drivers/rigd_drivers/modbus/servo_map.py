"""Defines the register map of a speed drive, for the driver :class:`ModbusServo`."""

from __future__ import annotations

from typing import Annotated, Self

from annotated_types import Ge, Gt, Le, MinLen
from pydantic import field_validator, model_validator

from rigd.sdk import In, wrong_entry
from rigd_drivers.modbus.registers import (
    Access,
    Condition,
    Described,
    Expect,
    Register,
    Write,
)


class Step(Write):
    """One step on the way to an enabled drive."""

    until: Condition | None = None
    """The next step is taken once this holds; at once, unless given."""


class Setting(Write):
    """A setting that rigd writes when it opens the drive."""

    keeps: bool = True
    """It reads back as written, and is checked to."""


class WatchdogMap(Described):
    """The communication watchdog of the drive."""

    time: Register
    """Its time."""
    scale: Annotated[float, In("s/count"), Gt(0)]
    """Time per count."""
    reaction: Annotated[float, In("s"), Ge(0)]
    """Time from its expiry until the motor has no torque."""
    tripped: Annotated[tuple[Condition, ...], MinLen(1)]
    """All hold once it has acted, until the drive is reset."""

    def spans(self) -> list[range]:
        """Return the registers that show whether the watchdog has acted."""
        return [range(c.address, c.address + 1) for c in self.tripped]


class ServoMap(Access):
    """Registers of a speed drive, and the writes that enable, disable and reset it."""

    setpoint: Register
    """Speed that the motor shall have, of either sign: int16, int32 or float32."""
    speed: Register
    """Speed that it has."""
    scale: Annotated[float, In("rad/s/count"), Gt(0)]
    """Speed of the motor per count of either register."""
    enabled: Annotated[tuple[Condition, ...], MinLen(1)]
    """All hold while the drive follows its setpoint."""
    fault: Annotated[tuple[Condition, ...], MinLen(1)]
    """All hold while the drive reports a fault."""
    watchdog: WatchdogMap
    """A drive without one is not supported: nothing would stop it when rigd is killed."""
    setup: tuple[Setting, ...] = ()
    """Written when it is opened, before the watchdog's time."""
    expect: tuple[Expect, ...] = ()
    """Settings it must have."""
    enable: Annotated[tuple[Step, ...], MinLen(1)]
    """Written, one step after the other, to enable it."""
    disable: Annotated[tuple[Write, ...], MinLen(1)]
    """Written to take the torque away."""
    reset: Annotated[tuple[Write, ...], MinLen(1)]
    """Written to leave a fault, disabled; each is held until the fault is gone, or for `hold`."""
    hold: Annotated[float, In("s"), Gt(0), Le(5)] = 0.2
    """Longest that a write of `reset` is held; a drive looks at its commands every 2 to 50 ms."""

    @field_validator("setpoint")
    @classmethod
    def _setpoint_has_a_sign(cls, setpoint: Register) -> Register:
        if setpoint.type.startswith("uint"):
            raise ValueError(
                f"{setpoint.type} holds no negative speed: name the register of the signed speed"
            )
        return setpoint

    @model_validator(mode="after")
    def _steps_are_seen(self) -> Self:
        polled = {address for span in self.polled() for address in span}
        for place, step in enumerate(self.enable):
            if step.until is not None and step.until.address not in polled:
                raise wrong_entry(
                    f"'until' looks at register {step.until.address}, which is not read in every "
                    "row: use one of 'enabled' or 'fault'",
                    "enable",
                    place,
                    "until",
                    "address",
                )
        return self

    def polled(self) -> list[range]:
        """Return the spans of registers that make a row."""
        conditions = (*self.enabled, *self.fault)
        return [self.speed.addresses, *(range(c.address, c.address + 1) for c in conditions)]
