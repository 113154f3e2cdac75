"""Controls a CiA 402 drive in cyclic torque mode; setpoint and measured value are in A."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal, Self

from annotated_types import Gt
from pydantic import model_validator

from rigd.sdk import (
    Channel,
    Declaration,
    DriverConfig,
    In,
    LinkConfig,
    ProtocolError,
    Row,
    wrong_entry,
)
from rigd_drivers.can.bus import CanBus
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.objects import Entry
from rigd_drivers.can.cia402_servo.config import ServoConfig
from rigd_drivers.can.cia402_servo.profile import Choice, torque_choice
from rigd_drivers.can.cia402_servo.ratings import (
    MAXON,
    Rating,
    agreed,
    rated_currents,
    rated_torques,
    torque_constants,
)
from rigd_drivers.can.cia402_servo.servo import Servo
from rigd_drivers.can.node import Node

#: Targets and actual values are per mille of a rating, 16 bits with sign (CiA 402-2).
_PER_MILLE = 1000
_LARGEST = 32767


class CurrentServoConfig(ServoConfig):
    """How per mille of the drive become a current."""

    current_range: Annotated[float, In("A"), Gt(0)]
    """Largest setpoint of either sign."""
    rated_current: Annotated[float, In("A"), Gt(0)] | None = None
    """Motor current at 1000 per mille of the target (object 6071), from the motor's plate; checked
    against objects 6075 and 6076. None: as the drive reports, if its unit is certain."""
    torque_constant: Annotated[float, In("N m/A"), Gt(0)] | None = None
    """Torque of the motor per current; with it, object 6076 gives the rated current too. None: as a
    drive of maxon reports (object 3001:5)."""
    measured: Literal["torque", "current"] | None = None
    """What the drive measures: `torque` is object 6077, `current` object 6078, both per mille.
    None: as `profile` has it, else `torque`."""

    @model_validator(mode="after")
    def _has_the_mode(self) -> Self:
        if self.profile is not None and self.profile.torque is None:
            raise wrong_entry(
                f"the profile of the {self.profile.title} has no torque mode: use the driver "
                "cia402-speed, or another profile",
                "profile",
            )
        return self

    def choice(self) -> Choice:
        """Return the mode of operation and its objects."""
        mode = None if self.profile is None else self.profile.torque
        measured = self.measured or ("torque" if mode is None else mode.measured)
        return torque_choice(mode, measured)


class CurrentRow(Row):
    """The motor; status: the drive's statusword (object 6041)."""

    current: float
    current_raw: float
    angle: float
    counts: float
    status: int


class CurrentServo(Servo[CurrentServoConfig]):
    """Sets the motor current, by per mille of a rated current.

    Safe means switched off: no current, the wheel coasts.
    """

    Config: ClassVar[type[DriverConfig]] = CurrentServoConfig
    title = "CiA 402 servo drive on CAN, current mode"
    range_option = "current_range"

    def __init__(self, config: CurrentServoConfig, link: CanBus) -> None:
        super().__init__(config, link)
        self._amperes = float("nan")  #: of one per mille, with sign; known once it is open
        self._radians = self._sign / config.counts_per_revolution

    @classmethod
    def declare(cls, config: CurrentServoConfig) -> Declaration:
        """Return current and angle of the motor, and the current as setpoint."""
        limit = config.current_range
        return Declaration(
            channels=(
                Channel("current", "A", "motor current, as the drive measures it"),
                Channel("current_raw", "1", "per mille of the rating", raw_of="current"),
                Channel("angle", "rad", "angle of the motor"),
                Channel("counts", "count", "position of the drive", raw_of="angle"),
            ),
            row=CurrentRow,
            setpoints=(Channel("current", "A", "motor current", -limit, limit),),
            silent_s=config.silent_s,
            watchdog_s=config.watchdog_s,
            actions=config.actions,
        )

    def write(self, setpoints: Sequence[float]) -> None:
        """Demand a current in A; it flows once the drive is enabled.

        Raises:
            DeviceError: the setpoint is NaN; the one before it holds.

        """
        current = self.accepted(self.declaration.setpoints[0], setpoints[0])
        self._send_target(round(current / self._amperes))

    def _row(self, values: Sequence[int]) -> CurrentRow:
        status, torque, position = values
        counts = self._unwrap.follow(position)
        angle = (counts - self._zero) * self._radians
        return CurrentRow.of(
            current=torque * self._amperes,
            current_raw=torque,
            angle=angle,
            counts=counts,
            status=status,
        )

    @classmethod
    def _feedback(cls, config: CurrentServoConfig) -> tuple[tuple[Entry, ...], ...]:
        return ((objects.STATUSWORD, config.choice().actual, objects.POSITION),)

    @classmethod
    def _choose(cls, config: CurrentServoConfig) -> Choice:
        return config.choice()

    @classmethod
    def contradictions(cls, config: CurrentServoConfig, link: LinkConfig | None) -> Sequence[str]:
        """Return what contradicts this drive on ``link``: its EDS, or two of its ratings."""
        problems = list(super().contradictions(config, link))
        current, by_torque = config.rated_current, _current_of_torque(config)
        if current is None or by_torque is None:
            return problems
        if not Rating(current, "").agrees_with(Rating(by_torque, "")):
            problems.append(
                f"`rated_torque` over `torque_constant` is {by_torque:.4g} A, `rated_current` "
                f"is {current:g} A: correct one of the three"
            )
        return problems

    @classmethod
    def _declared_target(cls, config: CurrentServoConfig) -> int | None:
        rated = config.rated_current or _current_of_torque(config)
        return None if rated is None else round(config.current_range / rated * _PER_MILLE)

    def _largest_target(self) -> int:
        return round(self.config.current_range / abs(self._amperes))

    def _check_ratings(self, node: Node) -> str:
        rating = self._rated_current(node)
        self._amperes = self._sign * rating.value / _PER_MILLE
        self._check_range(node)
        return f"1000 per mille = {rating.value:.4g} A by {rating.source}"

    def _rated_current(self, node: Node) -> Rating:
        """Return the rated current in A on which drive and rig file agree.

        Raises:
            ProtocolError: they do not, or nothing confirms the unit of what the drive reports.

        """
        config = self.config
        constant = agreed(
            node, "torque constant", "N m/A", torque_constants(node, config.torque_constant)
        )
        torques = rated_torques(node, config.rated_torque, config.unit_of_6076)
        torque = agreed(node, "rated torque", "N m", torques)
        reported = None if config.profile is None else config.profile.rated_current
        ratings = rated_currents(node, config.rated_current, reported)
        if torque is not None and constant is not None:
            ratings.append(torque.over(constant))
        rating = agreed(node, "rated current", "A", ratings)
        if rating is None:
            raise ProtocolError(
                f"{node} does not report what 1000 per mille of its target are: objects 6075 and "
                "6076 are 0 or missing, or `torque_constant` for 6076 is",
                hint="give `rated_current`, from the motor's plate",
            )
        by_torque = constant is not None and (config.rated_torque or config.unit_of_6076)
        stated = config.rated_current or reported or by_torque
        if not (node.vendor == MAXON or stated or len(ratings) > 1):
            raise ProtocolError(
                f"{node} has 1000 per mille at {rating.value:.4g} A by {rating.source}; nothing "
                "confirms the unit, which differs between makers",
                hint="give `rated_current`, from the motor's plate",
            )
        return rating

    def _limits(self, node: Node) -> tuple[tuple[Entry, float], ...]:
        """Return the objects that limit the current, each with its unit in A."""
        per_mille = abs(self._amperes)
        standard = ((objects.MAX_TORQUE, per_mille), (objects.MAX_CURRENT, per_mille))
        return (*standard, (objects.CURRENT_LIMIT, 1e-3)) if node.vendor == MAXON else standard

    def _check_range(self, node: Node) -> None:
        """Raise ProtocolError if the drive would limit a current that the rig file allows."""
        for entry, unit in self._limits(node):
            raw = node.read_optional(entry)
            limit = (raw or 0) * unit
            if raw and self.config.current_range > limit + unit / 2:
                raise ProtocolError(
                    f"{node} limits its current to {limit:.4g} A (object {entry}), "
                    f"`current_range` is {self.config.current_range:g} A",
                    hint="lower `current_range`, or raise the limit with the maker's tool",
                )
        reach = abs(self._amperes) * _LARGEST
        if self.config.current_range > reach:
            raise ProtocolError(
                f"{node} takes at most {reach:.3g} A ({_LARGEST} per mille of its rating), "
                f"`current_range` is {self.config.current_range:g} A",
                hint="one of them is wrong: compare `current_range` and the rating with the "
                "motor's plate",
            )


def _current_of_torque(config: CurrentServoConfig) -> float | None:
    """Return the rated current, in A, by torque and torque constant of the rig file."""
    if config.rated_torque is None or config.torque_constant is None:
        return None
    return config.rated_torque / config.torque_constant
