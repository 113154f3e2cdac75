"""Bridges single readings of an encoder that jump aside and come back."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rigd.analysis.result import BoolArray, FloatArray
from rigd_analyses.lugre.trials.resolution import Rounding
from rigd_analyses.lugre.trials.rows import BY_DEVIATION, CLEAR
from rigd_analyses.lugre.trials.trial import LugreTrial

ENCODERS = {"wheel encoder": "rad", "carriage encoder": "m"}
MOST_BRIDGED = 0.02  #: share of a trial's readings, as of rows that are missing
BY_COUNTS = math.sqrt(1.0 / 8.0)  #: of a reading less the mean of its neighbours, for each count
COMES_BACK = 0.25  #: of a spike: so exactly half of it, with the other sign, stands beside it


def without_spikes(trial: LugreTrial) -> LugreTrial:
    """Return ``trial`` with its spikes bridged by straight lines, and what they were.

    Where both encoders jump it is the rows that are wrong (:mod:`.rows`). An encoder with more
    spikes than may be bridged is left as it is.
    """
    wheel, carriage = trial.wheel_angle_rad, trial.carriage_position_m
    turned, by_wheel = _aside(wheel, trial.angle_rounding)
    moved, by_carriage = _aside(carriage, trial.position_rounding)
    wheel, of_wheel = _bridged(wheel, turned, by_wheel & ~by_carriage)
    carriage, of_carriage = _bridged(carriage, moved, by_carriage & ~by_wheel)
    spikes = dict(zip(ENCODERS, (of_wheel, of_carriage), strict=True))
    return replace(trial, wheel_angle_rad=wheel, carriage_position_m=carriage, spikes=spikes)


def spiky(trials: Sequence[LugreTrial]) -> list[str]:
    """Return a sentence on each encoder whose spikes were bridged in ``trials``."""
    found = []
    for encoder, unit in ENCODERS.items():
        spikes = [trial.spikes[encoder] for trial in trials if len(trial.spikes.get(encoder, ()))]
        if spikes:
            count, most = sum(map(len, spikes)), max(np.max(np.abs(sizes)) for sizes in spikes)
            found.append(
                f"the {encoder} has spikes: {count} single readings in {len(spikes)} trials jump "
                f"aside by up to {most:.2g} {unit} and come back. They were bridged; look at its "
                "cable, its screen and its counter."
            )
    return found


def _aside(values: FloatArray, rounding: Rounding) -> tuple[FloatArray, BoolArray]:
    """Return by how much ``values`` (n,) are off the lines through their neighbours (n - 2,).

    And where that is more than counts and noise make (n - 2,).
    """
    aside = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    spread = BY_DEVIATION * float(np.median(np.abs(aside)))
    sd = max(BY_COUNTS * rounding.of_reading, spread)
    return aside, np.abs(aside) > CLEAR * sd


def _bridged(
    values: FloatArray, aside: FloatArray, far: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return ``values`` (n,) without their spikes, and the sizes of these (k,).

    ``aside`` and ``far`` (n - 2,) are those of :func:`_aside`.
    """
    half = 0.5 * aside[1:-1]
    beside = np.maximum(np.abs(aside[:-2] + half), np.abs(aside[2:] + half))
    spike = far[1:-1] & (beside < 2.0 * COMES_BACK * np.abs(half))
    if np.mean(spike) > MOST_BRIDGED:
        return values, np.zeros(0)
    places = np.flatnonzero(spike) + 1
    bridged = values.copy()
    bridged[places + 1] -= aside[places]
    return bridged, aside[places]
