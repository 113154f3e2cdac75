"""Lateness of cycles, and the silence that it makes normal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rigd.config.loader import load_rig, parse_rig
from rigd.config.rig import Supervision
from rigd.daemon.doctor.bare_cycle import Lateness, measure
from rigd.daemon.doctor.check import CheckVerdict
from rigd.daemon.doctor.timing import lateness_check, silence_check, suggested_silence_s
from rigd.sdk.shipped_files import shipped_folder

ON_TIME = Lateness(10_000, 0, 30e-6, 60e-6, 90e-6, 200e-6, 1.2e-3)
HOLD = """\
controllers:
  place_hold: {measured: carriage.position, output: longitudinal_belt.speed, kp: 2 1/s,
    stale_after: 40 ms, limits: {low: 0 m, high: 1 m}}
"""


def test_slots_that_are_left_out_are_missed() -> None:
    slots = np.array([0, 1, 2, 5, 6])  # 3 and 4 passed without a cycle
    due = slots * 0.001
    late = Lateness.of(due, due + np.array([0, 0, 1e-4, 5e-4, 0]), 0.001)
    assert (late.cycles, late.missed) == (5, 2)
    assert late.max_s == pytest.approx(5e-4)
    assert late.longest_gap_s == pytest.approx(3e-3 + 4e-4)


@pytest.mark.parametrize(
    ("late", "verdict"),
    [
        (ON_TIME, CheckVerdict.OK),
        (replace(ON_TIME, missed=2), CheckVerdict.OK),
        (replace(ON_TIME, missed=20), CheckVerdict.WARN),
        (replace(ON_TIME, p99_s=2e-3), CheckVerdict.WARN),
        (replace(ON_TIME, missed=1000), CheckVerdict.FAIL),
    ],
)
def test_verdict_depends_on_missed_cycles(late: Lateness, verdict: CheckVerdict) -> None:
    check = lateness_check("timing", "cycle", late, 1_000_000)
    assert check.verdict is verdict
    assert bool(check.advice) == (verdict is not CheckVerdict.OK)


@pytest.mark.parametrize(
    ("gap_s", "silence_s"), [(1e-3, 0.05), (0.026, 0.1), (0.06, 0.15), (0.12, 0.25), (3.0, 6.0)]
)
def test_silence_suggested_is_twice_longest_gap_at_least(gap_s: float, silence_s: float) -> None:
    assert suggested_silence_s(gap_s) == silence_s


def test_too_short_silence_is_reported_with_better_value() -> None:
    rig = replace(load_rig("lugre-1"), supervision=Supervision(cycle_silence_s=0.05))
    fits = silence_check("timing", replace(ON_TIME, longest_gap_s=0.024), rig)
    stalls = silence_check("timing", replace(ON_TIME, longest_gap_s=0.030), rig)
    assert fits.verdict is CheckVerdict.OK
    assert stalls.verdict is CheckVerdict.WARN
    assert "cycle_silence: 100 ms" in stalls.advice


def test_stall_beyond_other_bounds_names_each() -> None:
    patient = Supervision(cycle_silence_s=0.25)
    rig = replace(load_rig("wire-1"), supervision=patient)
    rig = replace(rig, interlocks=tuple(replace(i, stale_after_s=0.12) for i in rig.interlocks))
    late = replace(ON_TIME, longest_gap_s=0.1)
    check = silence_check("timing", late, rig, {"traction": 0.101})
    assert check.verdict is CheckVerdict.WARN
    assert "the shortest bound of this rig is `watchdog` of traction, 101 ms" in check.found
    assert "`watchdog` of traction (101 ms), `stale_after` of " in check.advice
    assert "cycle_silence" not in check.advice  # long enough
    for interlock in rig.interlocks:
        assert interlock.name in check.advice


def test_stale_bounds_count_for_controllers() -> None:
    path = shipped_folder("configs") / "wire_lugre.yaml"
    text = path.read_text("utf-8").replace("\ninterlocks:\n", f"\n{HOLD}\ninterlocks:\n", 1)
    rig = replace(parse_rig(text, path), supervision=Supervision(cycle_silence_s=1.0))
    late = replace(ON_TIME, longest_gap_s=0.024)
    check = silence_check("timing", late, rig)
    assert check.advice.startswith("a stall would end a run by `stale_after` of place_hold (40 ms)")


def test_plant_in_the_cycle_has_no_stale_rows() -> None:
    rig = replace(load_rig("lugre-1"), supervision=Supervision(cycle_silence_s=0.25))
    late = replace(ON_TIME, longest_gap_s=0.1)
    assert silence_check("timing", late, rig).verdict is CheckVerdict.OK


def test_bare_cycle_keeps_its_rate_in_own_process() -> None:
    found = measure(5_000_000, 1.0)
    late = found.lateness
    assert late.cycles + late.missed == pytest.approx(150, abs=2)  # 200, 50 of them to warm up
    assert 0 <= late.p50_s <= late.p99_s <= late.p999_s <= late.max_s
    assert late.longest_gap_s >= 5e-3
    asked = " ".join([*found.granted, *found.lost])
    assert "SCHED_FIFO" in asked
    assert "memory" in asked
