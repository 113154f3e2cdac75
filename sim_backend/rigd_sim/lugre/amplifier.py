"""Simulates the amplifier of the LuGre rig's wheel: current mode, analogue current monitor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

from annotated_types import Gt, Le

from rigd.sdk import Channel, Declaration, Driver, DriverConfig, In, Row, accepted
from rigd_sim.lugre import layout
from rigd_sim.lugre.plant import LugrePlant


class AmplifierConfig(DriverConfig):
    """How monitor volts are converted to amperes, and the largest current."""

    current_range: Annotated[float, In("A"), Gt(0), Le(10)] = 2.0
    """Largest setpoint of either sign."""
    monitor_scale: Annotated[float, In("A/V"), Gt(0)] = 2.5
    """Current per volt of the monitor output."""
    monitor_inverted: bool = True
    """Whether a positive current gives a negative voltage (Maxon ADS 50/5: it does)."""
    monitor_zero: Annotated[float, In("V")] = 0.0
    """Voltage of the monitor at no current."""


class CurrentRow(Row):
    """The monitor; status: enabled 1, limited 2, saturated 4."""

    current: float
    current_raw: float
    status: int


class LugreAmplifier(Driver[AmplifierConfig, LugrePlant]):
    """Sets the motor current; safe means disabled, without current: the wheel coasts."""

    Config: ClassVar[type[DriverConfig]] = AmplifierConfig
    title: ClassVar[str] = "wheel servo of the simulated LuGre rig, current mode"

    def __init__(self, config: AmplifierConfig, link: LugrePlant) -> None:
        super().__init__(config, link)
        scale = config.monitor_scale
        self._scale = -scale if config.monitor_inverted else scale

    @classmethod
    def declare(cls, config: AmplifierConfig) -> Declaration:
        """Return the monitor's current and volts, and the current as setpoint."""
        limit = config.current_range
        volts = 10.0  # range of the data acquisition card
        most = volts * config.monitor_scale
        raw = "monitor output at the card"
        return Declaration(
            channels=(
                Channel("current", "A", "motor current by the monitor", -most, most),
                Channel("current_raw", "V", raw, -volts, volts, raw_of="current"),
            ),
            row=CurrentRow,
            setpoints=(Channel("current", "A", "motor current", -limit, limit),),
        )

    def open(self) -> None:
        """Do nothing: the plant stands as soon as the rig does."""

    def arm(self) -> None:
        """Enable the output at zero current."""
        self._demand(0.0, enabled=True)

    def read(self, t_ns: int) -> CurrentRow:
        """Return current, monitor volts and status."""
        readings = self.link.readings_at(t_ns)
        volts = readings[layout.CURRENT_VOLTS]
        return CurrentRow.of(
            current=(volts - self.config.monitor_zero) * self._scale,
            current_raw=volts,
            status=int(readings[layout.AMPLIFIER_STATUS]),
        )

    def write(self, setpoints: Sequence[float]) -> None:
        """Demand a current in A.

        Raises:
            DeviceError: the setpoint is NaN; the one before it holds.

        """
        current = accepted(self.declaration.setpoints[0], setpoints[0])
        self.link.commands[layout.WHEEL_CURRENT] = current

    def make_safe(self) -> None:
        """Switch the output off."""
        self._demand(0.0, enabled=False)

    def close(self) -> None:
        """Leave it safe: there is nothing to close, and opened again it is not armed."""
        self.make_safe()

    def _demand(self, current: float, *, enabled: bool) -> None:
        self.link.commands[layout.WHEEL_CURRENT] = current
        self.link.commands[layout.WHEEL_ENABLED] = float(enabled)
