"""Gives the drivers that take channels of other devices the values of each cycle."""

from __future__ import annotations

from collections.abc import Sequence

from rigd.engine.cycle.mount import MountedRig
from rigd.model.channels import ECHO
from rigd.sdk import Driver


class Inputs:
    """What one driver takes of the rig: its places in the tables of the cycle.

    Args:
        name: the device.
        driver: its driver.
        rig: the rig, whose tables these are.
        late_ns: for each entry of the table of times, the age at which it counts as late.
    """

    def __init__(self, name: str, driver: Driver, rig: MountedRig, late_ns: Sequence[int]) -> None:
        self.name = name
        self._driver = driver
        #: For each input: whether it is a reading (or a setpoint), and its place.
        self._places: list[tuple[bool, int]] = []
        owners: dict[int, int] = {}
        for item in driver.declaration.inputs:
            place = rig.readings.get(item.channel)
            if place is None:
                setpoint = item.channel.removesuffix(ECHO)
                self._places.append((False, rig.setpoints[setpoint]))
                continue
            self._places.append((True, place))
            owners[rig.stamp_of[place]] = late_ns[rig.stamp_of[place]]
        self._owners = tuple(owners.items())

    def give(
        self,
        t_ns: int,
        values: Sequence[float],
        stamps: Sequence[int],
        setpoints: Sequence[float],
    ) -> None:
        """Give the driver its inputs for the cycle at ``t_ns``.

        Raises:
            DeviceError: the driver cannot go on with them.
        """
        late = False
        for owner, late_ns in self._owners:
            late = late or t_ns - stamps[owner] > late_ns
        given = [
            values[place] if is_reading else setpoints[place] for is_reading, place in self._places
        ]
        self._driver.take_inputs(t_ns, given, late=late)


def inputs_of(rig: MountedRig, late_ns: Sequence[int]) -> Sequence[Inputs]:
    """Return the inputs of every driver of ``rig`` that takes some; see :class:`Inputs`."""
    return [
        Inputs(mount.name, mount.driver, rig, late_ns)
        for mount in rig.mounts
        if mount.driver.declaration.inputs
    ]
