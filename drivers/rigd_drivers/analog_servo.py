"""A servo amplifier in current mode with analogue set value and monitor, such as Maxon's ADS."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Self

from annotated_types import Gt, Le
from pydantic import model_validator

from rigd.sdk import Channel, DriverConfig, In
from rigd_drivers.analog_drive import AnalogDrive, AnalogDriveConfig, check_reach
from rigd_drivers.card import Card


class AnalogServoConfig(AnalogDriveConfig):
    """How amperes and volts belong together, and what the amplifier may be asked for."""

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


class AnalogServo(AnalogDrive):
    """Sets the motor current; safe means 0 V and disabled: the wheel coasts."""

    Config: ClassVar[type[DriverConfig]] = AnalogServoConfig
    title: ClassVar[str] = "analogue servo amplifier in current mode, on a card"
    config: AnalogServoConfig

    def __init__(self, config: AnalogServoConfig, link: Card | None) -> None:
        largest = config.current_range
        setpoint = Channel("current", "A", "motor current", -largest, largest)
        super().__init__(
            config,
            link,
            setpoint=setpoint,
            set_scale=config.set_scale,
            monitor_scale=config.monitor_scale,
        )
        self.setpoints = (setpoint,)
        self.channels = self.monitor_channels

    def read(self, t_ns: int) -> Sequence[float]:
        """Return current, monitor volts, status (:mod:`rigd_drivers.analog_drive`).

        Raises:
            DeviceError: the amplifier was enabled, and is not any more.

        """
        return self._monitor()

    def write(self, setpoints: Sequence[float]) -> None:
        """Demand a current in A.

        Raises:
            DeviceError: the setpoint is NaN; the one before it holds.

        """
        self._demand(setpoints[0])
