"""Maps the clock of a camera to the clock of the cycle."""

from __future__ import annotations

from typing import Final

#: How much slower the camera's clock may run, in ns per ns.
DRIFT: Final = 200e-6


class TimeBase:
    """Follows the least delay from exposure to arrival; all times are in ns.

    Both clocks have any zero. What arrives at t and was exposed at c by the camera's clock has
    lead t - c: the difference of the zeros plus a delay, which varies. The least of all leads is
    that of the frames that came soonest. It is followed down at once and up by :data:`DRIFT`
    alone, so that frames that come late are known to be old, and for long.
    """

    def __init__(self) -> None:
        self._lead_ns: float | None = None
        self._at_ns = 0

    def hear(self, t_ns: int, camera_ns: int) -> int:
        """Return when a frame would have arrived with the least delay; never after ``t_ns``."""
        lead_ns = float(t_ns - camera_ns)
        if self._lead_ns is not None:
            lead_ns = min(lead_ns, self._lead_ns + DRIFT * (t_ns - self._at_ns))
        self._lead_ns, self._at_ns = lead_ns, t_ns
        return min(camera_ns + round(lead_ns), t_ns)
