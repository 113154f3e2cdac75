"""Simulates the digital lines of an NI USB-6009 and the circuits on them; no gRPC.

The card has twelve static lines, eight in port 0 and four in port 1, each an input or an output. A
line that no task has driven since the card got its power is an input, pulled up to 5 V by 4.7 kohm.
A line that was driven keeps its level, also when its task is gone: the card has no watchdog (NI
USB-6008/6009 User Guide and Specifications, 371303, "Digital I/O", "Power-On States").
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Final

from rigd_sim.wire.cards.ni_card import DaqFault

LINES: Final = (
    *(f"port0/line{index}" for index in range(8)),
    *(f"port1/line{index}" for index in range(4)),
)
#: Sets the level of a line in what is wired to it.
Changed = Callable[[bool], None]


class Lines:
    """The lines of one card.

    Args:
        inputs: what drives a line from outside, such as ``{"port0/line2": one_shot_is_up}``.
        outputs: called with the level of a line whenever it changes, and once at the beginning.
    """

    def __init__(
        self, inputs: Mapping[str, Callable[[], bool]], outputs: Mapping[str, Changed]
    ) -> None:
        for name in (*inputs, *outputs):
            _known(name)
        self._inputs = inputs
        self._outputs = outputs
        self._driven: dict[str, bool] = {}
        for changed in outputs.values():
            changed(True)

    def level(self, line: str) -> bool:
        """Return whether ``line`` is high."""
        if line in self._driven:
            return self._driven[line]
        wired = self._inputs.get(line)
        return True if wired is None else wired()

    def drive(self, levels: Mapping[str, bool]) -> None:
        """Drive lines, all at the same moment."""
        before = {line: self.level(line) for line in levels}
        self._driven |= levels
        self._notify(line for line, high in levels.items() if high != before[line])

    def release(self, lines: Iterable[str] = LINES) -> None:
        """Make inputs of ``lines``: of all, if the card has lost its power."""
        driven = [line for line in lines if line in self._driven]
        low = [line for line in driven if not self._driven.pop(line)]
        self._notify(low)

    def _notify(self, lines: Iterable[str]) -> None:
        for line in lines:
            if line in self._outputs:
                self._outputs[line](self.level(line))


def parsed(lines: str, device: str) -> tuple[str, ...]:
    """Return the lines that a client names, as ``Dev1/port0/line0:1, Dev1/port1/line3``.

    Raises:
        DaqFault: they are not lines of ``device``.
    """
    found: list[str] = []
    for item in lines.split(","):
        owner, _, line = item.strip().partition("/")
        if owner != device:
            raise DaqFault(-200220, f"Device identifier is invalid. Device Specified: {owner}")
        stem, _, numbers = line.rpartition("line")
        first, _, last = numbers.partition(":")
        if not (first.isdigit() and (last or first).isdigit()):
            raise DaqFault(-200170, f"Physical channel specified does not exist: {line}")
        found += [f"{stem}line{number}" for number in range(int(first), int(last or first) + 1)]
    for name in found:
        _known(name)
    return tuple(found)


def _known(line: str) -> None:
    if line not in LINES:
        raise DaqFault(-200170, f"Physical channel specified does not exist: {line}")
