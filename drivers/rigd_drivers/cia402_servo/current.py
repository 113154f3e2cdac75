"""Controls a CiA 402 drive in cyclic torque mode; setpoint and measured value are in amperes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar

from annotated_types import Gt

from rigd.sdk import Channel, Declaration, DriverConfig, In, ProtocolError, Row
from rigd_drivers.can_bus import CanBus
from rigd_drivers.can_node import Node
from rigd_drivers.canopen import objects
from rigd_drivers.canopen.cia402 import Mode
from rigd_drivers.cia402_servo.servo import Servo, ServoConfig

#: Target and actual torque are per mille of the rated torque, 16 bits with sign (CiA 402-2).
_PER_MILLE = 1000
_LARGEST = 32767


class CurrentServoConfig(ServoConfig):
    """How torque in the drive's units becomes a current."""

    current_range: Annotated[float, In("A"), Gt(0)]
    """Largest setpoint of either sign."""
    torque_constant: Annotated[float, In("N m/A"), Gt(0)] | None = None
    """Torque of the motor per current; none: as the drive reports (object 3001:5, maxon EPOS4)."""


class CurrentRow(Row):
    """The motor; status: the drive's statusword (object 6041)."""

    current: float
    current_raw: float
    angle: float
    counts: float
    status: int


class CurrentServo(Servo[CurrentServoConfig]):
    """Sets the motor current, by torque over the torque constant.

    Safe means switched off: no current, the wheel coasts.
    """

    Config: ClassVar[type[DriverConfig]] = CurrentServoConfig
    title = "CiA 402 servo drive on CAN, current mode"
    mode = Mode.CYCLIC_TORQUE
    target = objects.TARGET_TORQUE
    range_option = "current_range"
    feedback = ((objects.STATUSWORD, objects.TORQUE, objects.POSITION),)

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
                Channel("current", "A", "motor current, from the drive's torque"),
                Channel(
                    "current_raw", "1", "torque in per mille of the rated torque", raw_of="current"
                ),
                Channel("angle", "rad", "angle of the motor"),
                Channel("counts", "count", "position of the drive", raw_of="angle"),
            ),
            row=CurrentRow,
            setpoints=(Channel("current", "A", "motor current", -limit, limit),),
            watchdog_s=config.watchdog_s,
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
    def _declared_target(cls, config: CurrentServoConfig) -> int | None:
        if config.rated_torque is None or config.torque_constant is None:
            return None
        amperes = config.rated_torque / _PER_MILLE / config.torque_constant
        return round(config.current_range / amperes)

    def _largest_target(self) -> int:
        return round(self.config.current_range / abs(self._amperes))

    def _check_ratings(self, node: Node) -> None:
        super()._check_ratings(node)
        given = self.config.torque_constant
        reported = node.read_optional(objects.TORQUE_CONSTANT)  # in µN m/A
        if reported is not None:
            self.agree(node, "torque constant", "3001:05", reported * 1e-6, given)
        elif given is None:
            raise ProtocolError(
                f"{node} does not report its torque constant (object 3001:05)",
                hint="give `torque_constant`, from the motor's data sheet",
            )
        constant = given if given is not None else (reported or 0) * 1e-6
        self._amperes = self._sign * self._rated_torque / _PER_MILLE / constant
        self._check_range(node)

    def _check_range(self, node: Node) -> None:
        """Raise ProtocolError if the drive would limit a current that the rig file allows."""
        limit = node.read_optional(objects.CURRENT_LIMIT)  # in mA
        if limit and self.config.current_range > limit * 1e-3:
            raise ProtocolError(
                f"{node} limits its current to {limit * 1e-3:g} A (object 3001:02), "
                f"`current_range` is {self.config.current_range:g} A",
                hint="lower `current_range`, or raise the limit with the maker's tool",
            )
        reach = abs(self._amperes) * _LARGEST
        if self.config.current_range > reach:
            raise ProtocolError(
                f"{node} takes at most {reach:.3g} A ({_LARGEST} per mille of its rated torque), "
                f"`current_range` is {self.config.current_range:g} A",
                hint="lower `current_range`, or correct the rated torque (object 6076)",
            )
