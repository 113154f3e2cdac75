"""Reads from a CiA 406 encoder what its counts are, and after how many they begin again.

A rotary encoder gives its position in its own steps (6501h, for 6502h revolutions), or scaled: bit
2 of 6000h or 6500h is set, and the position has 6001h units per revolution and begins again after
6002h.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from rigd.sdk import ProtocolError
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.node import Node

#: The position has 32 bits; an encoder that does not report its range uses them all.
WHOLE_OBJECT: Final = 1 << 32
#: Bit of 6000h and 6500h: the position is scaled by 6001h and 6002h.
_SCALED: Final = 1 << 2
#: Kinds of encoders in the device type that measure along a line (CiA 406, object 1000h).
_LINEAR: Final = (6, 7, 8, 9)
#: 6502h has 16 bits; encoders of more revolutions give the lower ones.
_REVOLUTIONS_MASK: Final = 0xFFFF
_TOLERANCE: Final = 1e-6
#: Unit of 6005h:1, in m.
_STEP_UNIT: Final = 1e-9


@dataclass(frozen=True)
class Resolution:
    """Counts per revolution and the range of counts, None if unknown, each with its source."""

    steps: int | None = None
    steps_by: str = "object 6501"
    span: int | None = None
    span_by: str = ""
    revolutions: int | None = None  #: object 6502, if the range was computed from it
    single_turn: bool = False  #: taken for one, as it has no object 6502

    def counts_per_radian(self, node: Node, given: float | None) -> float:
        """Return the counts per radian; ``given`` are those of the rig file.

        Raises:
            ProtocolError: they differ, or neither is known.

        """
        if not self.steps:
            if given is None:
                raise ProtocolError(
                    f"{node} does not report its resolution ({self.steps_by})",
                    hint="give `counts_per_revolution`, from its data sheet",
                )
            return given
        found = self.steps / (2 * math.pi)
        if given is not None and abs(found / given - 1) > _TOLERANCE:
            raise ProtocolError(
                f"{node} has {self.steps} counts per revolution ({self.steps_by}), the rig file "
                f"has {given * 2 * math.pi:.6g}",
                hint="correct `counts_per_revolution`, or the encoder's setting",
            )
        return found

    def range_of_counts(self, node: Node, bits: int | None) -> int:
        """Return after how many counts the position begins again; ``bits`` is of the rig file.

        Raises:
            ProtocolError: the rig file contradicts the encoder.

        """
        if self.span is None:
            return WHOLE_OBJECT if bits is None else 1 << bits
        if bits is None:
            return self.span
        if self.single_turn or self.span == 1 << bits or self._is_cut(1 << bits):
            return 1 << bits
        raise ProtocolError(
            f"{node} counts {self.span_by}, that is {math.log2(self.span):.6g} bits; the rig file "
            f"has {bits}",
            hint="leave `bits` out, or correct it",
        )

    def _is_cut(self, span: int) -> bool:
        """Return whether ``span`` counts are as many revolutions as 6502h has room for."""
        if self.revolutions is None or not self.steps or span % self.steps:
            return False
        revolutions = span // self.steps
        return revolutions > _REVOLUTIONS_MASK and (
            self.revolutions in (revolutions & _REVOLUTIONS_MASK, _REVOLUTIONS_MASK)
        )


def read_resolution(node: Node) -> Resolution:
    """Return what an opened encoder reports.

    Raises:
        LinkError, ProtocolError: it does not answer, or refuses.

    """
    # TR-Electronic's CEH-110 has no such bit in 6000h, and shows in 6500h alone that it is scaled
    # (its manual TR-ECE-BA-DGB-0080-05, pages 144 and 162); others have it in 6000h alone.
    switches = (objects.OPERATING_PARAMETERS, objects.OPERATING_STATUS)
    if any((node.read_optional(each) or 0) & _SCALED for each in switches):
        steps = node.read_optional(objects.UNITS_PER_REVOLUTION)
        span = node.read_optional(objects.MEASURING_RANGE)
        by = f"{span} units (object 6002)"
        return Resolution(steps or None, "object 6001", span or None, by)
    if node.device_type >> 16 & 0xFF in _LINEAR:
        return Resolution()  # 6501h is then a length
    steps = node.read_optional(objects.STEPS_PER_REVOLUTION)
    if not steps:
        return Resolution()
    revolutions = node.read_optional(objects.REVOLUTIONS)
    by = f"{steps} steps (object 6501) x {revolutions} revolutions (6502)"
    span, single_turn = steps * (revolutions or 1), revolutions is None
    return Resolution(steps, "object 6501", span, by, revolutions, single_turn)


def check_step(node: Node, given: float) -> None:
    """Raise ProtocolError if a linear encoder has another step, in m, than the rig file."""
    reported = node.read_optional(objects.LINEAR_STEP)
    if reported and abs(reported * _STEP_UNIT / given - 1) > _TOLERANCE:
        raise ProtocolError(
            f"{node} has steps of {reported * _STEP_UNIT:.6g} m (object 6005:01), "
            f"`distance_per_count` is {given:.6g} m",
            hint="correct `distance_per_count`, or the encoder's setting",
        )
