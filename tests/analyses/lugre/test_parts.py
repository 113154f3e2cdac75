"""Trials that no law of sliding describes are left out by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.lugre.wrong import BACK, right

from rigd.analysis import DataError
from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.trial import LugreTrial, sampling_period_s

CURRENTS_A = (0.45, 0.75, 1.05, 1.35)


def _stopped(trial: LugreTrial, share: float) -> LugreTrial:
    """Return ``trial`` with a carriage that stands after ``share`` of its way; the wheel turns."""
    position = trial.carriage_position_m.copy()
    away = np.abs(position - position[0])
    stops = int(np.argmax(away >= share * np.max(away)))
    position[stops:] = position[stops]
    return replace(trial, carriage_position_m=position)


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_carriage_that_stops_is_left_out(bench: Callable[..., Any], share: float) -> None:
    trials = bench("pvc").sweep(1, CURRENTS_A)
    trials[1] = _stopped(trials[1], share)
    kept, (rejected,) = sort_out(trials, [1e-3] * 4, Settings())
    assert [trial.label for trial, _ in kept] == ["0.45 A", "1.05 A", "1.35 A"]
    assert rejected.label == "0.75 A"
    assert "the carriage stands still from" in rejected.reason
    assert "while the wheel turns on" in rejected.reason


def test_carriages_that_all_stop_are_refused(bench: Callable[..., Any]) -> None:
    trials = [_stopped(trial, 0.5) for trial in bench("pvc").sweep(1, CURRENTS_A)]
    with pytest.raises(DataError, match=r"0\.45 A: the carriage stands still from"):
        sort_out(trials, [1e-3] * 4, Settings())


@pytest.mark.parametrize("floor", ["stone", "pvc", "paperboard"])
def test_drives_there_and_back_are_kept(floor: str) -> None:
    trials = replace(right(floor), program=BACK).trials(1)
    _, rejected = sort_out(trials, [sampling_period_s(item) for item in trials], Settings())
    assert not [item.reason for item in rejected if "stands still" in item.reason]
