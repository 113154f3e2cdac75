"""Runs spoilt at random: no exception, and no number that looks good."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.random import Generator
from support.approach_angle.corrected_method import analyse_better
from support.approach_angle.runs import drawn_rig, trial

from rigd_analyses.approach_angle.campaign.campaign import analyse_campaign
from rigd_analyses.approach_angle.paper import analyse_paper
from rigd_analyses.approach_angle.raw.run_data import AngleRun, FloatArray, KnownRun

#: Samples beyond all sense are reported; that sums of them overflow on the way is no news.
pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")

VOLTS = ("gauge_a_v", "gauge_b_v", "wheel_v", "platform_v", "normal_force_v")
NO_NUMBERS = (float("nan"), float("inf"), -float("inf"), 1e300, -1e308)


@cache
def good() -> KnownRun:
    """Return a run that slides, with a load cell."""
    return trial("clean_0", 4.0, 10.0, 1, 1, rig=drawn_rig(0), seed=3, load_cell=True).known


def volts(run: AngleRun, name: str) -> FloatArray:
    found: FloatArray = getattr(run, name).copy()
    return found


def kept(run: AngleRun, at: Any) -> AngleRun:
    """Return ``run`` with the samples at ``at`` only, or in that order."""
    return replace(run, **{name: getattr(run, name)[at] for name in ("t_s", *VOLTS)})


def spoilt(run: AngleRun, rng: Generator) -> AngleRun:
    """Return ``run`` with one thing wrong, drawn by ``rng``."""
    count = run.t_s.size
    if not count:
        return run
    first = int(rng.integers(count))
    last = min(count, first + int(rng.integers(1, count // 2 + 2)))
    name = str(rng.choice(VOLTS))
    signal = volts(run, name)
    match int(rng.integers(14)):
        case 0:
            return kept(run, slice(first))
        case 1:
            return kept(run, slice(first, None))
        case 2:
            return kept(run, np.r_[:first, last:count])
        case 3:
            return kept(run, slice(None, None, int(rng.choice([2, 5, 50, 4000]))))
        case 4:
            return kept(run, slice(None, None, -1))
        case 5:
            return kept(run, np.repeat(np.arange(count), 2))
        case 6:
            t_s = run.t_s.copy()
            t_s[first:last] = rng.choice(NO_NUMBERS)
            return replace(run, t_s=t_s)
        case 7:
            signal[first:last] = rng.choice(NO_NUMBERS)
        case 8:  # a wiper that lifts off, a thread that slips
            name = str(rng.choice(["wheel_v", "platform_v"]))
            signal = volts(run, name)
            signal[first:last] = signal[first]
        case 9:
            signal[:] = 0.0
        case 10:
            signal *= rng.choice([-1.0, 1e-300, 1e10])
        case 11:
            signal += rng.standard_normal(count)
        case 12:
            odd = (0.0, -1.0, *NO_NUMBERS)
            what = rng.choice(["stop_s", "load_n", "announced_load_kg"])
            changed: dict[str, Any] = {str(what): float(rng.choice(odd))}
            return replace(run, **changed)
        case _:
            signal += 1.0
    other: dict[str, Any] = {name: signal}
    return replace(run, **other)


def runs(seed: int, count: int) -> Sequence[KnownRun]:
    """Return spoilt runs, each with one to three things wrong."""
    rng, found = np.random.default_rng(seed), []
    for number in range(count):
        run = replace(good().run, number=number)
        for _ in range(int(rng.integers(1, 4))):
            run = spoilt(run, rng)
        found.append(replace(good(), run=run))
    return found


def near(value: float, expected: float) -> bool:
    """Return whether ``value`` is none, or what the run gives that is not spoilt."""
    return math.isnan(value) or abs(value / expected - 1.0) < 0.1


@pytest.mark.parametrize("seed", range(4))
def test_spoilt_run_gives_its_own_number_or_none(seed: int) -> None:
    calibration, rig = good().calibration, good().rig
    paper = analyse_paper(good().run, calibration, rig).mu
    better = analyse_better(good().run, calibration, rig).mu
    assert math.isfinite(paper) and math.isfinite(better)
    told = 0
    for known in runs(seed, 40):
        by_paper = analyse_paper(known.run, calibration, rig)
        ours = analyse_better(known.run, calibration, rig)
        # A campaign uses a run only if neither of both excludes it.
        assert near(by_paper.mu, paper) or ours.excluded, by_paper.flags
        assert near(ours.mu, better) or by_paper.excluded, ours.flags
        assert ours.flags or math.isfinite(ours.mu)  # no number without a reason
        assert by_paper.flags or math.isfinite(by_paper.mu)
        told += bool(ours.flags)
    assert told > 20


def test_campaign_of_spoilt_runs_gives_a_writable_result() -> None:
    result = analyse_campaign(runs(9, 60))
    assert all(run.flags for run in result.runs if math.isnan(run.better.mu))
    json.dumps(result.to_json(), allow_nan=False)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_campaign_of_few_runs_is_accepted(count: int) -> None:
    result = analyse_campaign([good()] * count)
    assert len(result.runs) == count and not result.trends
    json.dumps(result.to_json(), allow_nan=False)
