"""Simulates a CiA 404 measuring device with one channel, such as the transmitter of a load cell.

Source: Baumer StrainLink, CANopen manual V3.05, pages 34 to 36: process value, unit, digits, status
and autozero; an autozero beyond its range gets no answer.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import ClassVar, Final, Self

from rigd_sim.wire.can.canopen import misbehaviour
from rigd_sim.wire.can.canopen.dictionary import Abort, AbortCode, Entry, Kind
from rigd_sim.wire.can.canopen.ids import Identity
from rigd_sim.wire.can.canopen.node import CanopenNode
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.part import State

#: Measuring device of the device profile 404.
DEVICE_TYPE: Final = 0x00000194
#: "zero", low byte first.
ZERO: Final = 0x6F72657A
#: Status of the measurement: valid, overflow and underflow of its converter.
VALID, OVERFLOW, UNDERFLOW = 0, 3, 5
#: Largest value of its converter of either sign, and that up to which it can be set to zero.
LARGEST: Final = 30_000
ZERO_RANGE: Final = 10_000


class Cia404Transmitter(CanopenNode):
    """A transmitter on ``hub``; ``measure(t_ns)`` returns the quantity in its physical unit."""

    faults: ClassVar = {
        **misbehaviour.FAULTS,
        "overload": "its cell is loaded beyond its range: the value is not valid",
    }

    def __init__(
        self,
        name: str,
        hub: CanHub,
        node: int,
        measure: Callable[[int], float],
        *,
        digits: int = 2,
        unit: int = 0xFA010100,
        serial: int = 1,
    ) -> None:
        identity = Identity(DEVICE_TYPE, "rigd simulated cell", product=0x404, serial=serial)
        super().__init__(name, hub, node, identity)
        self._measure = measure
        self._digits = digits
        self._unit = unit
        self._offset = 0
        self._counts = 0

        def add(index: int, kind: Kind, value: int, *, mappable: bool = False) -> Entry:
            (entry,) = self.dictionary.array(
                index, [Entry(index, 1, kind, value, mappable=mappable)]
            )
            return entry

        self.dictionary.array(
            0x6125, [Entry(0x6125, 1, Kind.U32, 0, writable=True, check=self._set_zero)]
        )
        add(0x2112, Kind.U16, 0x7130)
        add(0x6131, Kind.U32, unit)
        add(0x6132, Kind.U8, digits)
        self._status = add(0x6150, Kind.U8, VALID, mappable=True)
        self._value = add(0x7130, Kind.I16, 0, mappable=True)

    def _set_zero(self, word: int) -> None:
        self.sample(time.monotonic_ns())
        if word != ZERO:
            raise Abort(AbortCode.VALUE_RANGE)
        if abs(self._counts) <= ZERO_RANGE:
            self._offset = self._counts

    def twin(self) -> Self:
        """Return a transmitter with the same id and another serial number, without a load."""
        return type(self)(
            f"{self.name} (twin)", self._hub, self.node, lambda _: 0.0,
            digits=self._digits, unit=self._unit, serial=self.identity.serial ^ 1,
        )  # fmt: skip

    def state(self) -> State:
        """Return the quantity that is really there, and the counts shown last."""
        true = self._measure(time.monotonic_ns())
        return {**super().state(), "quantity": true, "shown_counts": self._value.value}

    def sample(self, t_ns: int) -> None:
        """Measure; beyond the range of the converter the value is not valid."""
        self._counts = round(self._measure(t_ns) * 10**self._digits)
        if "overload" in self._bad.shown:
            self._counts = LARGEST + 1
        self._status.value = VALID
        if abs(self._counts) > LARGEST:
            self._status.value = OVERFLOW if self._counts > 0 else UNDERFLOW
        clipped = max(-LARGEST, min(self._counts, LARGEST))
        self._value.value = clipped - self._offset

    def apply(self, t_ns: int) -> None:
        """Do nothing: a transmitter takes no orders by PDO."""

    def connection_lost(self, t_ns: int, error: int) -> None:
        """Do nothing: a transmitter only measures."""

    def power_off(self, t_ns: int) -> None:
        """Forget the zero, which was not stored."""
        self._offset = 0
