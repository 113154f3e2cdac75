"""Random graphs and controllers in the engine: whatever is read, limits hold and trials end."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from numpy.typing import NDArray
from support.engine.any_loops import PERIOD_NS, Case, Loop, cases
from support.engine.bench import ListSink

from rigd.config.loader import parse_rig
from rigd.dry_run.holding import HoldingHost
from rigd.engine.clock import VirtualClock
from rigd.engine.cycle.wiring import wire
from rigd.engine.play.control import Control
from rigd.engine.sink import Rows
from rigd.model.severity import Severity
from rigd.procedure.program import Recorded


@dataclass
class KeptRows(ListSink):
    """Keeps the rows of every stream."""

    kept: dict[str, list[Rows]] = field(default_factory=dict)

    def write(self, stream: str, rows: Rows) -> None:
        self.kept.setdefault(stream, []).append(rows.copy())


class Played:
    """A case, played: what reached each device in each cycle, and what was recorded."""

    def __init__(self, case: Case) -> None:
        rig = parse_rig(case.text, Path("any.yaml"))
        clock, sink = VirtualClock(rig.period_ns, 1_790_000_000_000_000_000), KeptRows()
        self.cycle = wire(rig, clock, Control(), 1).cycle
        #: What was set before the first cycle, then what reached the device in each.
        self.written = {name: [limit.rest] for name, limit in case.limits.items()}
        self.taken: dict[str, list[int]] = {name: [] for name in case.read}
        for mount in self.cycle.rig.mounts:
            if mount.name in case.read:
                self._spoil(mount.name, mount.driver, case)
            elif f"{mount.name}." in " ".join(case.limits):
                self._watch(mount.name, mount.driver)
        record = {stream.name: Recorded() for stream in self.cycle.rig.streams}
        spans = {
            (0, segment.name): round(1e9 * (segment.duration_s or 0.0))
            for program, _ in case.programs
            for segment in program.segments
        }
        host = HoldingHost(self.cycle, clock, sink=sink, record=record, spans_ns=spans)
        assert not host.open()
        assert host.arm() is None
        host.trial = 0
        #: First cycle of each program, the one after its last, and how it ended.
        self.spans: list[tuple[int, int, Severity]] = []
        counters = self.cycle.counters
        for program, then in case.programs:
            began = counters.cycles
            outcome = host.play(program)
            self.spans.append((began, counters.cycles, outcome.severity))
            if outcome.severity >= Severity.ESTOP:
                assert outcome.severity is Severity.ESTOP or "gave no row" in outcome.reason
                break
            if then != "next":
                ended = host.come_to_rest() if then == "rest" else host.settle(30)
                if ended is not None and ended.severity >= Severity.ESTOP:
                    break
        host.drain()
        self.rows = {name: np.concatenate(rows) for name, rows in sink.kept.items()}

    def _spoil(self, name: str, driver: object, case: Case) -> None:
        read, plan, taken = driver.read, case.read[name], self.taken[name]  # type: ignore[attr-defined]
        kept = [0.0]

        def spoilt(t_ns: int) -> Sequence[float] | None:
            row: Sequence[float] = read(t_ns)
            number = len(taken)
            kind = plan[number] if number < len(plan) else "plant"
            before = taken[-1] if taken else t_ns
            taken.append(before if kind == "lost" else t_ns)
            if case.asked is not None and case.asked[0] == number:
                self.cycle.control.request(case.asked[1], "asked")
            if kind == "lost":
                return None
            if kind == "still":
                return (kept[0], *row[1:])
            if kind == "jump":
                return (row[0] + (-5.0) ** (number % 3), *row[1:])
            if isinstance(kind, float):
                return (kind, *row[1:])
            kept[:] = row[:1]
            return row

        driver.read = spoilt  # type: ignore[attr-defined]

    def _watch(self, name: str, driver: object) -> None:
        write, places = driver.write, [s.name for s in driver.declaration.setpoints]  # type: ignore[attr-defined]

        def watched(setpoints: Sequence[float]) -> None:
            for place, value in zip(places, setpoints, strict=True):
                self.written[f"{name}.{place}"].append(value)
            write(setpoints)

        driver.write = watched  # type: ignore[attr-defined]

    def column(self, channel: str) -> NDArray[np.float64]:
        stream, _, name = channel.partition(".")
        return np.asarray(self.rows[stream][name], dtype=float)

    def active(self, loop: Loop) -> NDArray[np.bool_]:
        """Return in which cycles ``loop`` acts; a last place stands for the time before all."""
        return np.append(self.column(f"{loop.name}.active") == 1, False)

    def set_before(self, loop: Loop, number: int, case: Case) -> float:
        """Return what was set before a cycle where ``loop`` commands."""
        if loop.output in self.written:
            return self.written[loop.output][number]
        inner = next(item for item in case.loops if item.name == loop.output)
        goals = np.append(
            self.column(inner.goal), np.clip(0.0, inner.bounds.low, inner.bounds.high)
        )
        return float(goals[number - 1])


def moved(before: float, after: float, rate: float) -> bool:
    """Return whether a setpoint went no farther than its rate allows, to rounding."""
    return abs(after - before) <= rate * 1e-9 * PERIOD_NS * (1 + 1e-9) + 1e-12


def losses(case: Case, played: Played, loop: Loop) -> NDArray[np.bool_]:
    """Return in which cycles ``loop`` acts on a reading that is no number, too old or frozen."""
    active = played.active(loop)
    times = np.arange(len(active) - 1) * PERIOD_NS
    lost = np.zeros(len(times), dtype=bool)
    start = played.cycle.clock.start_ns
    ages = {}
    for name in loop.inputs:
        taken = np.min([np.array(played.taken[item]) for item in case.uses[name]], axis=0) - start
        ages[name] = times - taken[: len(times)]
        lost |= ~np.isfinite(played.column(name)) | (ages[name] > loop.stale_ns)
    if loop.scheduled:
        lost |= played.column(loop.inputs[-1]) < 0
    measured, output = played.column(loop.inputs[0]), played.column(f"{loop.name}.output")
    changed, then, fresh = 0, math.nan, True
    for number in map(int, np.flatnonzero(active)):
        if not active[number - 1]:
            changed, then, fresh = number, played.set_before(loop, number, case), True
        elif measured[number] != measured[number - 1]:
            changed, then, fresh = number, float(output[number]), True
        fresh &= bool(ages[loop.inputs[0]][number] == 0)
        went = abs(output[number] - then) > 0.01 * (loop.span[1] - loop.span[0]) + 1e-9
        lost[number] |= bool(fresh and went and times[number] - times[changed] > loop.frozen_ns)
    return lost & active[:-1]


def check_limits(case: Case, played: Played) -> None:
    """Check every setpoint that reached a device, and those of controllers, in each cycle."""
    for name, limit in case.limits.items():
        values = played.written[name]
        for number, (before, after) in enumerate(itertools.pairwise(values)):
            assert limit.low <= after <= limit.high, (name, number)
            assert moved(before, after, limit.rate), (name, number, before, after)
    for loop in case.loops:
        goals, active = played.column(loop.goal), played.active(loop)
        low, high = loop.bounds.low, loop.bounds.high
        assert np.all((low <= goals) & (goals <= high)), loop.name
        begins = np.clip(np.nan_to_num(played.column(loop.inputs[0])), low, high)
        for number in map(int, np.flatnonzero(active)):
            known = active[number - 1] or math.isfinite(played.column(loop.inputs[0])[number])
            before = goals[number - 1] if active[number - 1] else begins[number]
            assert not known or moved(before, goals[number], loop.bounds.rate), (loop.name, number)
        # The last cycle of all may give up, and leaves the output where it was.
        outputs = played.column(f"{loop.name}.output")[active[:-1] & active[1:]]
        low, high = loop.span[0] - 1e-12, loop.span[1] + 1e-12
        assert np.all((low <= outputs) & (outputs <= high)), loop.name


def check_ends(case: Case, played: Played) -> None:
    """Check that a reading that is lost leads to rest from its cycle on, and ends the program."""
    for loop in case.loops:
        active = np.flatnonzero(played.active(loop))
        assert all(any(a <= n < b for a, b, _ in played.spans) for n in active), "outlives"
        for number in map(int, np.flatnonzero(losses(case, played, loop))):
            end, severity = next(s[1:] for s in played.spans if s[0] <= number < s[1])
            assert severity >= Severity.END_TRIAL, (loop.name, number, severity)
            if severity >= Severity.ESTOP:
                continue
            longest = 0
            for name, limit in case.limits.items():
                values = played.written[name]
                for cycle in range(number, end):
                    went = limit.to_rest(values[cycle])
                    assert values[cycle + 1] == pytest.approx(went, abs=1e-9), (name, cycle)
                away = abs(values[number] - limit.rest)
                # The last step may be a rounding error.
                longest = max(longest, math.floor(away / (limit.rate * 1e-3) + 1e-6) + 1)
            assert end - number <= longest + 1, (loop.name, number, end)


@settings(
    max_examples=25,
    phases=[Phase.reuse, Phase.generate],
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.large_base_example],
)
@given(cases())
def test_whatever_is_read_limits_hold_and_trials_end(case: Case) -> None:
    played = Played(case)
    check_limits(case, played)
    check_ends(case, played)
