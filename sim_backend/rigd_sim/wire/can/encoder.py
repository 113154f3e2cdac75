"""Simulates a CiA 406 absolute rotary encoder of many turns: position, speed, resolution.

As delivered its scaling is on (6000h, bit 2): the position counts 6001h units per turn and begins
again after 6002h. With it off, it counts the 6501h steps of the encoder itself, for 6502h turns.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Self

from rigd_sim.wire.can.canopen import misbehaviour
from rigd_sim.wire.can.canopen.dictionary import Entry, Kind
from rigd_sim.wire.can.canopen.ids import Identity
from rigd_sim.wire.can.canopen.node import CanopenNode
from rigd_sim.wire.can.hub import CanHub
from rigd_sim.wire.options import number, whole
from rigd_sim.wire.part import State

#: Absolute rotary encoder of many turns of the device profile 406 (CiA 406, object 1000).
DEVICE_TYPE: Final = 0x00020196
#: Bit of objects 6000 and 6500: the position is scaled.
SCALED: Final = 1 << 2
#: Steps of the encoder itself per turn.
STEPS: Final = 1 << 16


@dataclass(frozen=True)
class Scale:
    """Resolution and range of an encoder; after the last turn the position starts again."""

    counts_per_turn: int
    turns: int
    start: int = 0  #: position shown while the physics has counted nothing
    measure: str = "counts"  #: what observers call the quantity measured
    per_count: float = 1.0  #: that quantity per count, in SI

    @property
    def span(self) -> int:
        """Number of different positions."""
        return self.counts_per_turn * self.turns


class Cia406Encoder(CanopenNode):
    """An encoder on ``hub``; ``counts(t_ns)`` returns how far it was turned, without end."""

    faults: ClassVar = {
        **misbehaviour.FAULTS,
        "jump": "position jumps by so many counts, once (counts)",
        "index_reset": "position starts again at 0, once",
        "sign_flip": "counts the other way round",
        "missed_counts": "loses a part of the counts (fraction 0 to 1)",
    }

    def __init__(
        self,
        name: str,
        hub: CanHub,
        node: int,
        counts: Callable[[int], float],
        scale: Scale,
        *,
        serial: int = 1,
    ) -> None:
        identity = Identity(DEVICE_TYPE, "rigd simulated encoder", product=0x406, serial=serial)
        super().__init__(name, hub, node, identity)
        self._counts = counts
        self._scale = scale
        self._turned = 0.0
        self._shown = float(scale.start)
        self._last_ns = 0

        def add(index: int, sub: int, kind: Kind, value: int) -> Entry:
            return self.dictionary.add(Entry(index, sub, kind, value, mappable=True))

        def preset(value: int) -> None:
            self.sample(time.monotonic_ns())
            self._shown += (value - self._counted()) / self._per_turn() * scale.counts_per_turn

        self.dictionary.add(Entry(0x6003, 0, Kind.U32, 0, writable=True, changed=preset))
        self._position = add(0x6004, 0, Kind.U32, scale.start % scale.span)
        (self._speed,) = self.dictionary.array(
            0x6030, [Entry(0x6030, 1, Kind.I16, 0, mappable=True)]
        )
        status = add(0x6500, 0, Kind.U16, SCALED)

        def settings(value: int) -> None:
            status.value = value & SCALED

        self._settings = self.dictionary.add(
            Entry(0x6000, 0, Kind.U16, SCALED, writable=True, high=7, changed=settings)
        )
        self._units, self._range = (
            self.dictionary.add(Entry(index, 0, Kind.U32, value, writable=True, low=1))
            for index, value in ((0x6001, scale.counts_per_turn), (0x6002, scale.span))
        )
        add(0x6501, 0, Kind.U32, STEPS)
        add(0x6502, 0, Kind.U16, scale.turns)

    def twin(self) -> Self:
        """Return an encoder with the same id and another serial number, which stands still."""
        name, serial = f"{self.name} (twin)", self.identity.serial ^ 1
        return type(self)(name, self._hub, self.node, lambda _: 0.0, self._scale, serial=serial)

    def state(self) -> State:
        """Return the quantity that is really there, in SI, and the counts shown last."""
        true = self._counts(time.monotonic_ns()) * self._scale.per_count
        return {
            **super().state(), self._scale.measure: true, "shown_counts": self._position.value
        }  # fmt: skip

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault; see :meth:`CanopenNode.inject`."""
        super().inject(fault, **options)
        if fault == "jump":
            self._shown += self._bad.shown["jump"]["counts"]
            self._bad.hide(fault)
        elif fault == "index_reset":
            self._shown = 0.0
            self._bad.hide(fault)

    def read_options(self, fault: str, options: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options of ``fault``, complete."""
        given = dict(options)
        if fault == "jump":
            counts = whole(given, "counts", None, low=-(2**31), high=2**31)
            return {"counts": counts, **super().read_options(fault, given)}
        if fault == "missed_counts":
            fraction = number(given, "fraction", None, low=0.0, high=1.0)
            return {"fraction": fraction, **super().read_options(fault, given)}
        return super().read_options(fault, given)

    def sample(self, t_ns: int) -> None:
        """Take position and speed (in 1/min, object 6030:1)."""
        turned = self._counts(t_ns)
        step, self._turned = turned - self._turned, turned
        if self._bad.shown:
            if "sign_flip" in self._bad.shown:
                step = -step
            missed = self._bad.shown.get("missed_counts")
            if missed is not None:
                step *= 1.0 - missed["fraction"]
        self._shown += step
        self._position.value = self._counted()
        elapsed_min = (t_ns - self._last_ns) / 60e9
        self._last_ns = t_ns
        speed = step / self._scale.counts_per_turn / elapsed_min if elapsed_min > 0 else 0.0
        self._speed.value = max(-(2**15), min(round(speed), 2**15 - 1))

    def _counted(self) -> int:
        """Return the position as the settings have it."""
        scaled = self._settings.value & SCALED
        span = self._range.value if scaled else STEPS * self._scale.turns
        return round(self._shown / self._scale.counts_per_turn * self._per_turn()) % span

    def _per_turn(self) -> int:
        return self._units.value if self._settings.value & SCALED else STEPS

    def apply(self, t_ns: int) -> None:
        """Do nothing: an encoder takes no orders."""

    def connection_lost(self, t_ns: int, error: int) -> None:
        """Do nothing: an encoder only measures."""

    def power_off(self, t_ns: int) -> None:
        """Do nothing: an absolute encoder keeps its position when it is switched on again."""
