"""Controls a servo amplifier in current mode, such as Maxon's ADS, by an analogue set value.

The amplifier returns the motor current as an analogue monitor voltage.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Self

from annotated_types import Gt, Le
from pydantic import model_validator

from rigd.sdk import Channel, Declaration, DriverConfig, In, Row
from rigd_drivers.cards.analog_drive import AnalogDrive, AnalogDriveConfig, check_reach
from rigd_drivers.cards.card import Card


class AnalogServoConfig(AnalogDriveConfig):
    """How currents are converted to volts and back, and the largest current that rigd may set."""

    current_range: Annotated[float, In("A"), Gt(0), Le(100)]
    """Largest setpoint of either sign."""
    set_scale: Annotated[float, In("A/V"), Gt(0)]
    """Current per volt of the set value."""
    monitor_scale: Annotated[float, In("A/V"), Gt(0)]
    """Current per volt of the monitor."""
    monitor_inverted: bool = True
    """Whether a positive current gives a negative voltage (Maxon ADS 50/5: it does)."""

    @model_validator(mode="after")
    def _within_reach(self) -> Self:
        check_reach("current_range", self.current_range, self.set_scale)
        return self


class CurrentRow(Row):
    """Current, the monitor's volts, and the status of :mod:`rigd_drivers.cards.analog_drive`."""

    current: float
    current_raw: float
    status: int


class AnalogServo(AnalogDrive[AnalogServoConfig]):
    """Sets the motor current; safe means 0 V and disabled: the wheel coasts."""

    Config: ClassVar[type[DriverConfig]] = AnalogServoConfig
    title: ClassVar[str] = "analogue servo amplifier in current mode, on a card"

    def __init__(self, config: AnalogServoConfig, link: Card) -> None:
        super().__init__(
            config, link, set_scale=config.set_scale, monitor_scale=config.monitor_scale
        )

    @classmethod
    def declare(cls, config: AnalogServoConfig) -> Declaration:
        """Return the monitor's channels and the current as setpoint."""
        largest = config.current_range
        setpoint = Channel("current", "A", "motor current", -largest, largest)
        return Declaration(
            channels=config.monitor_channels(setpoint, config.monitor_scale),
            row=CurrentRow,
            setpoints=(setpoint,),
        )

    def read(self, t_ns: int) -> CurrentRow:
        """Return current, monitor volts and status.

        Raises:
            DeviceError: the amplifier was enabled, and is not any more.

        """
        current, volts, status = self._monitor()
        return CurrentRow.of(current=current, current_raw=volts, status=status)

    def write(self, setpoints: Sequence[float]) -> None:
        """Demand a current in A.

        Raises:
            DeviceError: the setpoint is NaN; the one before it holds.

        """
        self._demand(setpoints[0])
