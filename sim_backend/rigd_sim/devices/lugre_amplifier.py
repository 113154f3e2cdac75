"""The amplifier of the wheel in current mode, with its analogue current monitor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

from annotated_types import Gt, Le

from rigd.sdk import Channel, Driver, DriverConfig, In, accepted
from rigd_sim.plants.lugre import layout
from rigd_sim.plants.lugre.plant import LugrePlant


class AmplifierConfig(DriverConfig):
    """How the monitor's volts become amperes, and what the amplifier may be asked for."""

    current_range: Annotated[float, In("A"), Gt(0), Le(10)] = 2.0
    """Largest setpoint of either sign."""
    monitor_scale: Annotated[float, In("A/V"), Gt(0)] = 2.5
    """Current per volt of the monitor output."""
    monitor_inverted: bool = True
    """Whether a positive current gives a negative voltage (Maxon ADS 50/5: it does)."""
    monitor_zero: Annotated[float, In("V")] = 0.0
    """Voltage of the monitor at no current."""


class LugreAmplifier(Driver):
    """Sets the motor current; safe means disabled, without current: the wheel coasts."""

    Config: ClassVar[type[DriverConfig]] = AmplifierConfig
    title: ClassVar[str] = "wheel servo of the simulated LuGre rig, current mode"
    has_status = True
    config: AmplifierConfig
    link: LugrePlant

    def __init__(self, config: AmplifierConfig, link: LugrePlant | None) -> None:
        super().__init__(config, link)
        limit = config.current_range
        self.setpoints = (Channel("current", "A", "motor current", -limit, limit),)
        scale = config.monitor_scale
        volts = 10.0  # range of the data acquisition card
        self.channels = (
            Channel("current", "A", "motor current by the monitor", -volts * scale, volts * scale),
            Channel(
                "current_raw", "V", "monitor output at the card", -volts, volts, raw_of="current"
            ),
        )
        self._scale = -scale if config.monitor_inverted else scale

    def open(self) -> None:
        """Do nothing: the plant stands as soon as the rig does."""

    def arm(self) -> None:
        """Enable the output at zero current."""
        self._demand(0.0, enabled=True)

    def read(self, t_ns: int) -> Sequence[float]:
        """Return current, monitor volts, status (enabled 1, limited 2, saturated 4)."""
        readings = self.link.readings_at(t_ns)
        volts = readings[layout.CURRENT_VOLTS]
        return (
            (volts - self.config.monitor_zero) * self._scale,
            volts,
            int(readings[layout.AMPLIFIER_STATUS]),
        )

    def write(self, setpoints: Sequence[float]) -> None:
        """Demand a current in A.

        Raises:
            DeviceError: the setpoint is NaN; the one before it holds.

        """
        self.link.commands[layout.WHEEL_CURRENT] = accepted(self.setpoints[0], setpoints[0])

    def make_safe(self) -> None:
        """Switch the output off."""
        self._demand(0.0, enabled=False)

    def _demand(self, current: float, *, enabled: bool) -> None:
        if self.link is not None:
            self.link.commands[layout.WHEEL_CURRENT] = current
            self.link.commands[layout.WHEEL_ENABLED] = float(enabled)
