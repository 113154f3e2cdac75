"""Holds every step of a dry run that can be held, once and in its midst, and resumes it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

from rigd.engine.clock import Clock
from rigd.engine.cycle.cycle import Cycle
from rigd.engine.play.holding import HoldPhase
from rigd.engine.play.player import Outcome
from rigd.engine.process.in_process import InProcessHost
from rigd.engine.sink import Sink
from rigd.procedure.program import CompiledProcedure, CycleProgram, Hold, Recorded, Step

#: A step is held for this time in s, or for 0.9 of the longest that it may be.
HELD_S: Final = 3.0


class HoldingHost(InProcessHost):
    """Plays as :class:`InProcessHost` does; asks for a pause and resumes as a person would.

    ``spans_ns`` has how long each step took without, by trial and name: the pause comes after half.
    """

    def __init__(
        self,
        cycle: Cycle,
        clock: Clock,
        *,
        sink: Sink,
        record: Mapping[str, Recorded],
        spans_ns: Mapping[tuple[int, str], int],
    ) -> None:
        super().__init__(cycle, clock, virtual=True, sink=sink, record=record)
        self._spans_ns = spans_ns
        self._held: list[tuple[str, Hold]] = []

    def play(self, program: CycleProgram, then: CycleProgram | None = None) -> Outcome:
        """Play ``program`` to its end, and hold each of its steps that was not held before."""
        holds = {item.name: item.hold for item in program.segments if item.hold is not None}
        control, cycle = self.cycle.control, self.cycle
        inside, since = "", 0
        cycle.load(program)
        while (outcome := self._step()) is None:
            name, now = cycle.segment, cycle.t_ns
            if name != inside:
                inside, since, control.pause_wanted = name, now, False
            hold = holds.get(name)
            if hold is None or (name, hold) in self._held:
                continue
            if cycle.phase is HoldPhase.HELD:
                if now - since >= 1e9 * min(HELD_S, 0.9 * hold.longest_s):
                    control.pause_wanted = False
                    self._held.append((name, hold))
                continue
            half_ns = self._spans_ns.get((self.trial, name), 0) // 2
            if not control.pause_wanted and now - since >= half_ns:
                control.pause_wanted, since = True, now
        control.pause_wanted = False
        if cycle.phase is HoldPhase.HELD:  # the hold ended the program
            cycle.load(None)
        self.on_drain()  # the run sees that nothing is held any more
        return outcome


def with_holds(procedure: CompiledProcedure) -> CompiledProcedure:
    """Return ``procedure`` with those trials alone in which a step can be held, each kind once."""
    known = list(_holds(procedure.prepare))
    trials = []
    for trial in procedure.trials:
        new = [item for item in _holds((*trial.steps, *trial.after)) if item not in known]
        if new:
            trials.append(trial)
            known += new
    return replace(procedure, trials=tuple(trials))


def can_be_held(procedure: CompiledProcedure) -> bool:
    """Return whether a step of ``procedure`` can be held."""
    return bool(with_holds(procedure).trials) or any(_holds(procedure.prepare))


def spans_of(steps: Sequence[tuple[int, int, str]], end_ns: int) -> Mapping[tuple[int, str], int]:
    """Return how long each step took when it was played first, by trial and name, in ns."""
    ends = [*(t_ns for t_ns, _, _ in steps[1:]), end_ns]
    spans: dict[tuple[int, str], int] = {}
    for (begin, trial, name), end in zip(steps, ends, strict=False):  # perhaps no step began
        spans.setdefault((trial, name), end - begin)
    return spans


def _holds(steps: Sequence[Step]) -> Iterator[tuple[str, Hold]]:
    for step in steps:
        for segment in step.segments if isinstance(step, CycleProgram) else ():
            if segment.hold is not None:
                yield segment.name, segment.hold
