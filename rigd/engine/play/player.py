"""Plays the compiled steps of a procedure (a cycle program) on a rig, one cycle at a time.

The player computes the setpoint profiles and checks the end conditions and the limits of a trial.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableSequence, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from rigd.computed.controllers.chain import through
from rigd.engine.play.conditions import Taken, Watches
from rigd.engine.play.holding import Holding, HoldPhase
from rigd.engine.play.interlocks import Trip
from rigd.model.severity import Severity, WayOut, way_out
from rigd.procedure.conditions.condition_text import describe_left, describe_values
from rigd.procedure.profiles.profiles import ConstantProfile, Profile
from rigd.procedure.program import (
    CycleProgram,
    OnTimeout,
    Segment,
)


@dataclass(frozen=True)
class Outcome:
    """How a cycle program ended, with the reason as text and the trip that caused it.

    ``last_values`` are the last values of the channels for which the last segment waited.
    """

    severity: Severity
    reason: str = ""
    trip: Trip | None = None
    last_values: Mapping[str, float] = field(default_factory=dict, compare=False)

    @property
    def latched(self) -> bool:
        """Whether it was ended by an interlock that stays tripped until acknowledged."""
        return self.trip is not None and self.trip.interlock.latch

    @property
    def way_out(self) -> WayOut:
        """How a run ends with this outcome."""
        return way_out(self.severity, tripped=self.trip is not None, latched=self.latched)


class Player:
    """One cycle program bound to the tables of a rig.

    Call :meth:`step` once per cycle with the newest values; it updates the wanted setpoints in
    place and returns an outcome when the program has ended. The next segment begins within the same
    cycle. ``readings`` and ``setpoints`` map each name to its place in the values of a cycle;
    ``readings`` also contains status words, as ``device.status``. ``loops`` maps the setpoint of
    each controller to what it commands. ``taken`` has the times of the values.

    Raises:
        KeyError: the program names an unknown channel or setpoint.
    """

    def __init__(
        self,
        program: CycleProgram,
        readings: Mapping[str, int],
        setpoints: Mapping[str, int],
        loops: Mapping[str, str] = MappingProxyType({}),
        taken: Taken | None = None,
    ) -> None:
        self._segments = program.segments
        #: For each segment the setpoints of the controllers that act in it.
        self._controllers = list(
            through(loops, (segment.setpoints for segment in program.segments))
        )
        self._watches = [Watches(segment.until, readings, taken) for segment in program.segments]
        self._profiles = [
            [(setpoints[name], profile) for name, profile in segment.setpoints.items()]
            for segment in program.segments
        ]
        self._holds = [
            None if segment.hold is None else Holding(segment.hold, controllers, setpoints, loops)
            for segment, controllers in zip(program.segments, self._controllers, strict=True)
        ]
        self._limits = [
            (readings[limit.channel], limit.low, limit.high, limit) for limit in program.limits
        ]
        self._position = -1
        self._began_ns = 0
        self._moving: list[tuple[int, Profile, float]] = []  # profiles that change in time
        self.entered: list[str] = []  #: names of segments entered in the last step

    @property
    def segment(self) -> Segment | None:
        """The present segment."""
        inside = 0 <= self._position < len(self._segments)
        return self._segments[self._position] if inside else None

    @property
    def acting(self) -> frozenset[str]:
        """The setpoints of the controllers that act in the present segment."""
        hold = self._hold
        if hold is not None and hold.phase is HoldPhase.HELD:
            return hold.acting
        return self._controllers[self._position]

    @property
    def phase(self) -> HoldPhase:
        """How far the hold of the present segment is."""
        return HoldPhase.NONE if self._hold is None else self._hold.phase

    @property
    def _hold(self) -> Holding | None:
        inside = 0 <= self._position < len(self._segments)
        return self._holds[self._position] if inside else None

    def step(
        self,
        t_ns: int,
        values: Sequence[float],
        wanted: MutableSequence[float],
        applied: Sequence[float] = (),
        *,
        pause: bool = False,
    ) -> Outcome | None:
        """Check ``values`` of the cycle at ``t_ns``, set ``wanted``; return None while it plays.

        With ``pause`` a segment that can be held is held. Its time then stands still: no end
        condition is checked, only the limits of the trial. ``applied`` are the setpoints after the
        limiter: profiles begin there.
        """
        if self.entered:
            self.entered = []
        for index, low, high, limit in self._limits:
            value = values[index]
            if not low <= value <= high:
                return Outcome(Severity.END_TRIAL, describe_left(limit, value))
        hold = self._hold
        if hold is not None and hold.phase is not HoldPhase.NONE:
            if hold.too_long(t_ns):
                name, longest_s = self._segments[self._position].name, hold.longest_s
                reason = f"step {name!r} was held for {longest_s:.6g} s, the longest allowed"
                return Outcome(Severity.END_TRIAL, reason)
            took_ns = hold.step(t_ns, pause, wanted, applied)
            if took_ns is None:
                return None
            self._began_ns += took_ns
            self._watches[self._position].shift(took_ns)
        while True:
            over = self._position < 0 or self._segment_over(t_ns, values)
            if isinstance(over, Outcome):
                return over
            if not over:
                break
            if self._position == len(self._segments) - 1:
                last_values = self._last_values(values)
                self._position += 1
                return Outcome(Severity.DONE, last_values=last_values)
            self._position += 1
            self._enter(t_ns, wanted, applied or wanted)
        hold = self._hold
        if pause and hold is not None:
            hold.begin(t_ns, wanted, applied)
            return None
        if self._moving:
            t_s = (t_ns - self._began_ns) * 1e-9
            for place, profile, initial in self._moving:
                wanted[place] = profile.at(t_s, initial)
        return None

    def _enter(self, t_ns: int, wanted: MutableSequence[float], before: Sequence[float]) -> None:
        """Begin the segment at the present position, with its setpoints from ``before`` on."""
        self._began_ns = t_ns
        self._watches[self._position].restart(t_ns)
        self._moving.clear()
        self.entered.append(self._segments[self._position].name)
        for place, profile in self._profiles[self._position]:
            initial = before[place]  # not what was wanted: the limiter may still be on its way
            wanted[place] = profile.at(0.0, initial)
            if not isinstance(profile, ConstantProfile):
                self._moving.append((place, profile, initial))

    def _segment_over(self, t_ns: int, values: Sequence[float]) -> bool | Outcome:
        """Return whether the segment has ended; an outcome if its timeout ends the program."""
        segment = self._segments[self._position]
        if self._watches[self._position].met(t_ns, values):
            return True
        elapsed_ns = t_ns - self._began_ns
        if segment.duration_s is not None and elapsed_ns >= round(segment.duration_s * 1e9):
            return True
        if segment.timeout_s is None or elapsed_ns < round(segment.timeout_s * 1e9):
            return False
        if segment.on_timeout is OnTimeout.NEXT:
            return True
        last_values = self._last_values(values)
        reason = f"step {segment.name!r} did not end within {segment.timeout_s:.6g} s"
        if where := describe_values(segment.until, last_values):
            reason += f": {where}"
        early = segment.on_timeout is OnTimeout.END_TRIAL
        return Outcome(
            Severity.END_TRIAL if early else Severity.FAIL, reason, last_values=last_values
        )

    def _last_values(self, values: Sequence[float]) -> Mapping[str, float]:
        """Return the newest value of every channel for which the present segment waits."""
        if self._position < 0:
            return {}
        return self._watches[self._position].values(values)
