"""Simulates analogue motor drives, and the one-shot that gates their enable lines.

A one-shot is a retriggerable monostable: each edge on its input keeps its output up for a time.
"""

from __future__ import annotations

from collections.abc import Callable


class OneShot:
    """A retriggerable one-shot: up for ``time_s`` after every edge on its input.

    ``dead`` is a fault: it stays up for ever.
    """

    def __init__(self, time_s: float, clock_ns: Callable[[], int]) -> None:
        self._time_ns = round(time_s * 1e9)
        self._clock_ns = clock_ns
        self._level = False
        self._edge_ns: int | None = None
        self.dead = False

    def trigger(self, *, level: bool) -> None:
        """Take the level of the input line."""
        if level != self._level:
            self._level = level
            self._edge_ns = self._clock_ns()

    @property
    def drops_ns(self) -> int | None:
        """When it drops, or has dropped, without another edge; None: never, 0: it never rose."""
        if self.dead:
            return None
        return 0 if self._edge_ns is None else self._edge_ns + self._time_ns

    @property
    def up(self) -> bool:
        """Whether it is up now."""
        if self.dead:
            return True
        return self._edge_ns is not None and self._clock_ns() - self._edge_ns < self._time_ns


class AnalogDrive:
    """A drive with analogue set value: ``demand`` follows the volts while it is enabled.

    Args:
        per_volt: demand per volt of the set value.
        one_shot: gates the enable line; None: nothing does.

    """

    def __init__(self, per_volt: float, one_shot: OneShot | None) -> None:
        self._per_volt = per_volt
        self._one_shot = one_shot
        self._volts = 0.0
        self._line = False
        self.faulty = False  #: reports a fault and drives nothing

    def set_volts(self, volts: float) -> None:
        """Take the set value in V."""
        self._volts = volts

    def set_line(self, *, high: bool) -> None:
        """Take the enable line."""
        self._line = high

    @property
    def enabled(self) -> bool:
        """Whether it drives now."""
        gated = self._one_shot is not None and not self._one_shot.up
        return self._line and not gated and not self.faulty

    @property
    def demand(self) -> float:
        """What it is asked for; 0 while it does not drive."""
        return self._volts * self._per_volt if self.enabled else 0.0
