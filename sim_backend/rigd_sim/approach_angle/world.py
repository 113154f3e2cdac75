"""Simulates the approach-angle rig in real time: the plant, its relay, and the relay's one-shot.

A one-shot is a retriggerable monostable: each edge on its input keeps its output up for a fixed
time. If the rig has one, the coil of the relay has current only while the one-shot is up and the
line of the relay asks for it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.plant import AnglePlant
from rigd_sim.wire.cards.analog_drives import OneShot
from rigd_sim.wire.part import State


@dataclass(frozen=True)
class Opened:
    """State of the platform at the last command to open the relay."""

    at_ns: int = 0  #: CLOCK_MONOTONIC
    position: float = math.nan  #: of the platform, m
    speed: float = math.nan  #: of the platform, m/s
    volts: float = math.nan  #: of its potentiometer, without noise


class AngleWorld:
    """The simulated rig that all devices of the bench share; for one thread.

    The coil of the relay has current while its line asks for it and the one-shot is up; ``welded``
    and ``broken`` are faults of the relay.

    Args:
        plant: the rig.
        one_shot_s: how long the one-shot stays up after an edge; None: there is none.
        clock_ns: the time of all.
    """

    def __init__(
        self,
        plant: AnglePlant,
        one_shot_s: float | None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.plant = plant
        self.one_shot = None if one_shot_s is None else OneShot(one_shot_s, clock_ns)
        self.refused = ""  #: why the plant could not be driven when the relay closed
        self.opened = Opened()
        self.safe_since_ns = clock_ns()  #: since when the coil has no current; 0: it has
        self.closings = 0  #: how often it got current
        self.furthest = -math.inf  #: where the platform has been since, m
        self._clock_ns = clock_ns
        self._asked = False
        self._welded = self._broken = False
        self._set_up: dict[str, float | int | bool | str] = {
            "angle": plant.config.angle,
            "wheel": plant.config.wheel,
            "load": plant.config.load,
            "voltage": plant.config.voltage,
        }
        self.now()

    def now(self) -> int:
        """Bring the plant to this moment, which is returned; the one-shot drops on its way."""
        now_ns = self._clock_ns()
        drops_ns = None if self.one_shot is None else self.one_shot.drops_ns
        if not self.safe_since_ns and drops_ns is not None and drops_ns <= now_ns:
            self._advance(drops_ns)
            self._switch()
        self._advance(now_ns)
        self._switch()
        return now_ns

    def ask(self, *, closed: bool) -> None:
        """Have the line of the relay ask for current, or not."""
        self.now()
        self._asked = closed
        self._switch()

    def trigger(self, *, level: bool) -> None:
        """Give the one-shot's input a level."""
        if self.one_shot is not None:
            self.now()
            self.one_shot.trigger(level=level)
            self._switch()

    def one_shot_up(self) -> bool:
        """Return whether the one-shot is up."""
        return self.one_shot is not None and self.one_shot.up

    def spoil(self, *, welded: bool, broken: bool) -> None:
        """Make the contact stay closed, or never close, with any coil current."""
        self.now()
        self._welded, self._broken = welded, broken
        self._switch()

    def change(self, quantity: str, value: float | str) -> None:
        """Change the bench at this moment; see :meth:`AnglePlant.change`."""
        self.now()
        self.plant.change(quantity, value)
        self._set_up[quantity] = value

    def state(self) -> State:
        """Return the hidden state of the plant, and what people have set up."""
        self.now()
        names = (name for name, _, _ in layout.TRUTH)
        return {
            **dict(zip(names, self.plant.truth, strict=True)),
            "resting": self.plant.resting,
            **self._set_up,
        }

    def _advance(self, t_ns: int) -> None:
        if t_ns > self.plant.now_ns:
            self.plant.advance(t_ns)
            self.furthest = max(self.furthest, self.plant.truth[0])

    def _switch(self) -> None:
        """Hand the plant what the coil and the contact do at the moment it stands at."""
        at_ns = self.plant.now_ns
        current = self._asked and (self.one_shot is None or self._up_at(at_ns))
        if current and self.safe_since_ns:
            self.safe_since_ns = 0
            self.closings += 1
            self.furthest = self.plant.truth[0]
        elif not current and not self.safe_since_ns:
            self.safe_since_ns = at_ns
            self._note(at_ns)
        try:
            self.plant.command((current or self._welded) and not self._broken)
            self.refused = ""
        except ValueError as error:  # no friction is known of what is set up: it stays open
            self.refused = str(error)

    def _up_at(self, t_ns: int) -> bool:
        drops_ns = 0 if self.one_shot is None else self.one_shot.drops_ns
        return drops_ns is None or t_ns < drops_ns

    def _note(self, at_ns: int) -> None:
        row = self.plant.history[self.plant.steps % layout.HISTORY_ROWS]
        position, speed = self.plant.truth[:2]
        volts = float(row[layout.SIGNALS.index("platform_position")])
        self.opened = Opened(at_ns, position, speed, volts)
