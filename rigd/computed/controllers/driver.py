"""Makes a controller a device of the rig: its setpoint is set, its terms are channels."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rigd.computed.driver import Computed, ComputedConfig
from rigd.model.channels import Channel
from rigd.sdk import Declaration

if TYPE_CHECKING:  # a rig file is checked without numpy
    from rigd.computed.controllers.bank import Bank

#: Name in recordings and lists, in place of that of a driver.
CONTROLLER: Final = "controller"
#: The channels of a controller after the measured value; ``output`` and the terms are in the unit
#: of what it commands.
OWN: Final = (
    "error", "proportional", "integral", "derivative", "forward", "output", "saturated", "active",
)  # fmt: skip


class ControllerConfig(ComputedConfig):
    """A checked controller in SI; made by rigd from `controllers`."""

    name: str
    """Name of the controller."""
    measured: str
    """The channel that it holds at its setpoint."""
    unit: str
    """Unit of the measured channel."""
    output: str
    """The setpoint that it commands: of a device, or of another controller."""
    output_unit: str
    """Unit of what it commands."""
    needs: frozenset[str]
    """The devices, groups and controllers without which it cannot work."""
    low: float
    """Lowest output."""
    high: float
    """Highest output."""
    kp: float = 0.0
    """Proportional gain, output per measured."""
    ki: float = 0.0
    """Integral gain, output per measured and second."""
    kd: float = 0.0
    """Derivative gain, output times second per measured."""
    filter_s: float = 0.0
    """Time constant of the filter of the derivative."""
    weight: float = 1.0
    """Weight of the setpoint in the proportional term."""
    relay: float = 0.0
    """Half of the jump of a relay in place of the gains, in the unit of the output; 0: a PID."""
    hysteresis: float = 0.0
    """Error at which the relay passes over, in the unit of the measured channel."""
    forward: str | None = None
    """The channel that is added to the output."""
    schedule: str | None = None
    """The channel by which all gains are multiplied."""
    stale_s: float = 0.05
    """Age at which a channel that it uses counts as lost."""
    frozen_s: float = 1.0
    """Time without any change of the measured value, while the output moves, after which it counts
    as frozen.
    """
    frozen_always: bool = False
    """Whether it counts as frozen while the output does not move too."""
    stuck_s: float = 2.0
    """Time at a limit without progress."""

    @property
    def setpoint(self) -> str:
        """Its setpoint, as ``controller.channel``."""
        return f"{self.name}.{self.measured.partition('.')[2]}"

    @property
    def inputs(self) -> tuple[str, ...]:
        """The channels that it uses, the measured one first."""
        return tuple(item for item in (self.measured, self.forward, self.schedule) if item)


class Controller(Computed[ControllerConfig, "Bank"]):
    """A controller in the cycle: it acts in steps that set it; its output passes the limiter."""

    title = "controller"
    Config = ControllerConfig

    def __init__(self, config: ControllerConfig, link: Bank) -> None:
        super().__init__(config, link)
        self.packed = link.packed[link.places[config.name]]

    @classmethod
    def declare(cls, config: ControllerConfig) -> Declaration:
        """Return the measured value, the terms, and the setpoint."""
        short, unit, out = config.measured.partition(".")[2], config.unit, config.output_unit
        goal = config.output
        channels = (
            Channel(short, unit, f"{config.measured} as the controller read it"),
            Channel("error", unit, "setpoint less measured value; 0 while it is off"),
            Channel("proportional", out, "proportional term, or relay; 0 while it is off"),
            Channel("integral", out, "integral term, with what the limits took back"),
            Channel("derivative", out, "derivative term, filtered"),
            Channel("forward", out, "feed-forward"),
            Channel("output", out, f"what it asks of {goal}; while it is off, what is set there"),
            Channel(
                "saturated", "1", "1 at the highest output, -1 at the lowest, else 0", -1.0, 1.0
            ),
            Channel("active", "1", "1 while it acts, else 0", 0.0, 1.0),
        )
        setpoint = Channel(short, unit, f"{config.measured} to be held by {goal}")
        return Declaration(channels=channels, plain_rows=True, setpoints=(setpoint,))
