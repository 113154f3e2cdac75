"""Simulates the two belt drives of the LuGre rig: speed servos along and across the guide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

from annotated_types import Gt, Le

from rigd.sdk import Channel, Declaration, Driver, DriverConfig, In, Row, accepted
from rigd_sim.lugre import layout
from rigd_sim.lugre.plant import LugrePlant


class BeltConfig(DriverConfig):
    """Which belt it is, and the largest speed that rigd may set."""

    axis: Literal["longitudinal", "lateral"]
    """Along the guide (brakes and returns the carriage) or across it (moves the bridge)."""
    speed_range: Annotated[float, In("m/s"), Gt(0), Le(3)] | None = None
    """Largest setpoint of either sign; by default 2.5 m/s along and 0.8 m/s across."""


class BeltRow(Row):
    """The belt; status: enabled 1, clutched 2, limited 4, at the end stop 8."""

    position: float
    speed: float
    force: float
    status: int


class LugreBelt(Driver[BeltConfig, LugrePlant]):
    """A belt drive behind a clutch; the belt and its encoder always move with the carriage.

    Safe means *braked*: speed zero with the clutch engaged. The clutch is spring-applied, so that
    losing power engages it; released, a carriage at 2 m/s would run into its end stop, and the
    bridge would coast 0.8 m on a travel of 0.6 m. Until armed the drive is in that state too.
    """

    Config: ClassVar[type[DriverConfig]] = BeltConfig
    title: ClassVar[str] = "belt drive of the simulated LuGre rig, speed servo"

    def __init__(self, config: BeltConfig, link: LugrePlant) -> None:
        super().__init__(config, link)
        along = config.axis == "longitudinal"
        self._readings = layout.BELT_READINGS if along else layout.BRIDGE_READINGS
        self._command = layout.BELT_COMMANDS if along else layout.LATERAL_COMMANDS
        self._enabled = False

    @classmethod
    def declare(cls, config: BeltConfig) -> Declaration:
        """Return the belt as channels, speed and clutch as setpoints."""
        along = config.axis == "longitudinal"
        limit = config.speed_range or (2.5 if along else 0.8)
        way, end = ("along", 1.8) if along else ("across", 0.7)
        return Declaration(
            channels=(
                Channel("position", "m", f"position {way} the guide", -0.1, end),
                Channel("speed", "m/s", f"speed {way} the guide", -5.0, 5.0),
                Channel("force", "N", "force of the drive on the carriage", -200.0, 200.0),
            ),
            row=BeltRow,
            setpoints=(
                Channel("speed", "m/s", f"speed {way} the guide", -limit, limit),
                Channel("engaged", "1", "clutch: 1 engaged, 0 released (no force)", 0.0, 1.0),
            ),
        )

    def open(self) -> None:
        """Do nothing: the plant stands as soon as the rig does."""

    def arm(self) -> None:
        """Take setpoints from now on; braked until the first."""
        self._brake()
        self._enabled = True

    def read(self, t_ns: int) -> BeltRow:
        """Return position, speed, force and status."""
        first = self._readings
        position, speed, force, status = self.link.readings_at(t_ns)[first : first + 4]
        word = int(status) | self._enabled
        return BeltRow.of(position=position, speed=speed, force=force, status=word)

    def write(self, setpoints: Sequence[float]) -> None:
        """Set the speed in m/s and the clutch (above one half: engaged).

        Raises:
            DeviceError: a setpoint is NaN; those before it hold.

        """
        declared = self.declaration.setpoints
        speed = accepted(declared[0], setpoints[0])
        engaged = accepted(declared[1], setpoints[1]) > 0.5
        if self._enabled:
            commands = self.link.commands
            commands[self._command] = speed
            commands[self._command + 1] = float(engaged)

    def make_safe(self) -> None:
        """Brake to standstill with the clutch engaged, and hold; take no more setpoints."""
        self._brake()
        self._enabled = False

    def close(self) -> None:
        """Leave it safe: there is nothing to close, and opened again it is not armed."""
        self.make_safe()

    def _brake(self) -> None:
        self.link.commands[self._command] = 0.0
        self.link.commands[self._command + 1] = 1.0
