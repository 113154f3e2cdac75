"""Holds the tables of a cycle in one memory, which all compiled functions of the cycle share."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, MutableSequence, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from struct import Struct
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigd.model.channels import ECHO

#: The place of what is not in the tables.
NOWHERE: Final = -1


class TablePlace(NamedTuple):
    """Where a value and its time stand in the memory, and the age above which it is late."""

    value: int
    stamp: int
    late_ns: int


@dataclass(eq=False)
class Tables:
    """The tables of a cycle, lists that stay the same objects, with their copy in :attr:`words`.

    ``values`` are of all channels, ``stamps`` their times: ``stamp_of`` has the place of the time
    of each value, ``late_ns`` for each time the age above which it is late. ``applied`` are the
    setpoints as they were written, ``wanted`` those of this cycle. ``rows`` are the places of the
    rows that are computed, by name: of the first value, and of the time. All values and times
    before the places ``read`` come from devices. The times from the place ``rows_end`` on are of
    derived channels, of the oldest reading in each; the memory alone has the newest too.
    """

    values: MutableSequence[float]
    stamps: MutableSequence[int]
    applied: MutableSequence[float]
    wanted: MutableSequence[float]
    readings: Mapping[str, int]
    stamp_of: Sequence[int]
    late_ns: Sequence[int]
    setpoints: Mapping[str, int]
    rows: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    read: tuple[int, int] | None = None
    rows_end: int | None = None
    #: Eight bytes for each number: the time of the cycle, ``stamps``, ``wanted``, ``applied``,
    #: ``values``, 0 and NaN for what the rig lacks, then the newest times in derived channels.
    words: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        stamps, rows_end = len(self.stamps), self.rows_end
        self._derived = stamps if rows_end is None else rows_end
        setpoints, values = [len(self.wanted), len(self.applied)], len(self.values)
        sizes = [1, stamps, *setpoints, values, 1, 1, stamps - self._derived]
        (
            self._now, self._stamps, self._wanted, self._applied, self._values, self._no_time,
            self._unknown, self._newest, end,
        ) = accumulate(sizes, initial=0)  # fmt: skip
        self.words = np.zeros(end, dtype=np.int64)
        floats = self.words.view(np.float64)
        floats[self._values : self._no_time] = floats[self._unknown] = math.nan
        self._memory = self.words.data.cast("B")
        values, stamps = self.read or (len(self.values), len(self.stamps))
        self._read = slice(values), slice(stamps)
        self._pack_times = Struct(f"={1 + stamps}q").pack_into
        self._pack_values = Struct(f"={len(self.applied) + values}d").pack_into
        self._pack_wanted = Struct(f"={len(self.wanted)}d").pack_into
        self._unpack_setpoints = Struct(f"={len(self.wanted) + len(self.applied)}d").unpack_from

    def source(self, name: str) -> TablePlace:
        """Return where a channel, or a setpoint as it was written (``NAME_setpoint``), stands."""
        if (place := self.readings.get(name)) is not None:
            owner = self.stamp_of[place]
            return TablePlace(self._values + place, self._stamps + owner, self.late_ns[owner])
        if (place := self.setpoints.get(name.removesuffix(ECHO))) is not None:
            return TablePlace(self._applied + place, self._now, 0)
        return TablePlace(self._unknown, self._no_time, 0)

    def stamp_at(self, place: int) -> int:
        """Return where the time at ``place`` stands in the memory."""
        return self._stamps + place

    def newest_at(self, place: int) -> int:
        """Return where the time of the newest reading in a value of time ``place`` stands."""
        derived = place - self._derived
        return self._stamps + place if derived < 0 else self._newest + derived

    def stamp(self, place: int, t_ns: int) -> None:
        """Set the time at ``place`` to ``t_ns``, in the list and in memory."""
        self.stamps[place] = self.words[self._stamps + place] = t_ns

    def asked(self, setpoint: str) -> tuple[int, int]:
        """Return where ``setpoint`` as it is wanted stands in the memory, and as it is applied."""
        place = self.setpoints[setpoint]
        return self._wanted + place, self._applied + place

    def row(self, name: str) -> tuple[int, int]:
        """Return where the row ``name`` begins in the memory, and where its time stands."""
        if name not in self.rows:
            return NOWHERE, NOWHERE
        value, stamp = self.rows[name]
        return self._values + value, self._stamps + stamp

    def take(self, t_ns: int) -> None:
        """Copy what the devices gave for the cycle at ``t_ns``, and what was written, to memory."""
        values, stamps = self._read
        self._pack_times(self._memory, 0, t_ns, *self.stamps[stamps])
        self._pack_values(self._memory, 8 * self._applied, *self.applied, *self.values[values])

    def take_wanted(self) -> None:
        """Copy the wanted setpoints to memory."""
        self._pack_wanted(self._memory, 8 * self._wanted, *self.wanted)

    def show_setpoints(self) -> None:
        """Copy the setpoints, wanted and applied, from memory to their lists."""
        found, count = self._unpack_setpoints(self._memory, 8 * self._wanted), len(self.wanted)
        self.wanted[:], self.applied[:] = found[:count], found[count:]

    def shows(self, values: slice, stamps: slice) -> Callable[[], None]:
        """Return what copies computed ``values`` and ``stamps`` from memory to their lists."""
        unpack_values = Struct(f"={values.stop - values.start}d").unpack_from
        unpack_stamps = Struct(f"={stamps.stop - stamps.start}q").unpack_from
        memory = self._memory
        first, then = 8 * (self._values + values.start), 8 * (self._stamps + stamps.start)

        def show() -> None:
            self.values[values] = unpack_values(memory, first)
            self.stamps[stamps] = unpack_stamps(memory, then)

        return show
