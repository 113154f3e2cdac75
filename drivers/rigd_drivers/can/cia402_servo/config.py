"""Defines the options that every CiA 402 drive has."""

from __future__ import annotations

from typing import Annotated, TypeVar

from annotated_types import Ge, Gt, Le

from rigd.sdk import Declaration, In
from rigd_drivers.can.cia402_servo.homing import Method
from rigd_drivers.can.cia402_servo.profile import DrivePdos, DriveProfile
from rigd_drivers.can.sheet import NodeConfig
from rigd_drivers.device_file import FromFile


class ServoConfig(NodeConfig):
    """The options of the drive: its identity, and the scaling of its units."""

    profile: Annotated[DriveProfile, FromFile("cia402")] | None = None
    """What is known of this make of drive: the name of a shipped profile (elmo-gold,
    kollmorgen-akd, maxon-epos4, nanotec), a file of your own beside the rig file, such as
    my_drive.yaml, or a profile written here. None: the drive is as CiA 402-2 has it. Options of
    the rig file come before it."""
    counts_per_revolution: Annotated[float, In("count/rad"), Gt(0)]
    """Counts of the position (object 6064) per revolution of the motor, as in `4096 count/rev`."""
    inverted: bool = False
    """Whether the drive's positive direction is the rig's negative one."""
    zero: Annotated[float, In("count")] | None = None
    """Count (object 6064) at zero, of a homed or absolute axis; none: that at opening."""
    homing: Method | None = None
    """Homing method of the action `home`: 37, or 35 of older drives. The position where the drive
    stands becomes 0; it is enabled for that for a moment, and does not move. None: as `profile` has
    it, else it has no such action."""
    rated_torque: Annotated[float, In("N m"), Gt(0)] | None = None
    """Rated torque of the motor, to which object 6076 must be set; none: any."""
    torque_unit: Annotated[float, In("N m"), Gt(0)] | None = None
    """Unit of object 6076; none: as `profile` has it, else 1 mN m (CiA 402-2), of a
    drive of maxon 1 uN m."""
    follows_bit: bool | None = None
    """Whether bit 12 of the statusword (object 6041) shows that the drive follows its target, as
    CiA 402-2 has it in the cyclic modes; false for drives that leave it 0. None: as `profile` has
    it, else true."""
    watchdog: Annotated[float, In("s"), Ge(0.01), Le(5)] = 0.1
    """The drive switches itself off after so long without a heartbeat of rigd. It has failed if
    it is itself silent for longer, and for more than 100 ms."""

    @property
    def pdos(self) -> DrivePdos:
        """Which PDOs carry what."""
        return DrivePdos() if self.profile is None else self.profile.pdos

    @property
    def homing_method(self) -> Method | None:
        """Homing method of the action `home`; None: it has no such action."""
        profiled = None if self.profile is None else self.profile.homing
        return self.homing or profiled

    @property
    def actions(self) -> dict[str, str]:
        """What a person may ask of the drive, by name."""
        if self.homing_method is None:
            return {}
        return {"home": "sets the position where the drive stands to 0, by its homing mode"}

    @property
    def unit_of_6076(self) -> float | None:
        """Unit of the motor rated torque in N m, as far as rig file or profile know it."""
        profiled = None if self.profile is None else self.profile.torque_unit
        return self.torque_unit or profiled

    @property
    def watchdog_s(self) -> float:
        """Until it is off: half as long again, for its own tick, and 50 ms for the news."""
        return 1.5 * self.watchdog + 0.05

    @property
    def silent_s(self) -> float:
        """Time without a row after which the drive has failed, in s: its watchdog acts before."""
        return max(Declaration.silent_s, self.watchdog)


ServoConfigT = TypeVar("ServoConfigT", bound=ServoConfig)
