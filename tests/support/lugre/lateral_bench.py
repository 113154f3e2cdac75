"""Drives during lateral motion, from the small rig of :mod:`support.lugre.bench`.

The rollers' friction is found by going round Eqs. 22, 25 and 26 until it stands, not by a closed
form. It shares no code with the identification or with rigd_sim.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from support.lugre.bench import Bench

from rigd_analyses.lugre.lateral.constants import LateralConstants, LateralTrial
from rigd_analyses.lugre.trials.known_constants import Known

FloatArray = NDArray[np.float64]

DRY, VISCOUS = 0.035, 0.03  #: of the rollers; 1 and s/m
ROW_DISTANCE_M, MASS_OFFSET_M, HEIGHT_M = 0.04, -0.012, 0.25
SPEEDS_M_S = (0.2, 0.35, 0.5, 0.65)
CURRENTS_A = (0.6, 0.9, 1.2, 1.5)
TRAVEL_M = 0.48  #: of the bridge, from its start until it is stopped
REST_S = 0.35
SETTLING_S = 0.03  #: in which the last of the bridge's speed is reached
LACKING = 0.04  #: share of the speed that lacks when the wheel is driven


def roller_force(
    speed_m_s: FloatArray, weight_n: float, *, physical: bool = False, dry: float = DRY,
    viscous: float = VISCOUS,
) -> FloatArray:  # fmt: skip
    """Return G in N at lateral speeds (n,); ``physical``: a lifted row does not rub."""
    coefficient = dry * np.tanh(speed_m_s / 1e-3) + viscous * speed_m_s
    force = coefficient * weight_n
    if physical:
        return force
    for _ in range(400):
        first = (-weight_n * MASS_OFFSET_M - force * HEIGHT_M) / ROW_DISTANCE_M
        second = (weight_n * (MASS_OFFSET_M + ROW_DISTANCE_M) + force * HEIGHT_M) / ROW_DISTANCE_M
        force = coefficient * (np.abs(first) + np.abs(second))
    return force


@dataclass(frozen=True)
class LateralBench:
    """Makes the trials of a lateral sweep on stone as the rig records them."""

    noisy: bool = True
    physical: bool = False
    floor: str = "stone"
    mass_kg: float = 3.9593
    dry: float = DRY
    viscous: float = VISCOUS

    @property
    def bench(self) -> Bench:
        """Return the rig without lateral motion."""
        return Bench(self.floor, self.mass_kg, self.noisy)

    @property
    def constants(self) -> LateralConstants:
        """Return the rig-file constants of the coupling."""
        return LateralConstants(
            lever=Known(0.012, 6e-4),
            height=Known(HEIGHT_M, 1e-3),
            half_span=Known(0.03, 5e-4),
            row_distance=Known(ROW_DISTANCE_M, 5e-4),
            mass_offset=Known(MASS_OFFSET_M, 5e-4),
            bearing_spacing=0.04,
            bearing_overhang=0.03,
        )

    def trial(self, current_a: float, speed_m_s: float, seed: int) -> LateralTrial:
        """Return one drive at a lateral speed of either sign; 0 m/s is a bridge at rest."""
        limit_s = REST_S + (TRAVEL_M / abs(speed_m_s) if speed_m_s else 2.0)
        bench = replace(self.bench, max_s=min(limit_s, 3.0))
        count = round((bench.max_s + 0.1) / bench.dt_s)
        driven_s = np.arange(count) * bench.dt_s - REST_S
        lacking = LACKING * np.exp(-np.maximum(driven_s, 0.0) / SETTLING_S)
        speed = speed_m_s * (1.0 - lacking)
        weight = bench.mass_kg * 9.81
        push = roller_force(
            speed, weight, physical=self.physical, dry=self.dry, viscous=self.viscous
        )
        key = seed * 1000 + round(1e2 * abs(speed_m_s)) * 2 + (speed_m_s < 0.0)
        trial = replace(bench, lateral_n=push).trial(current_a, key)
        speed = speed[: len(trial.t_s)]
        if self.noisy:
            noise = np.random.default_rng([key, 7]).standard_normal(len(speed))
            speed = np.round((speed + 1e-3 * noise) / 1e-4) * 1e-4
        label = f"{current_a:.2f} A, {speed_m_s:+.2f} m/s"
        return LateralTrial(replace(trial, label=label), speed, abs(speed_m_s))

    def sweep(
        self,
        seed: int = 1,
        speeds: Sequence[float] = SPEEDS_M_S,
        currents: Sequence[float] = CURRENTS_A,
        signs: Sequence[int] = (1, -1),
    ) -> list[LateralTrial]:
        """Return the trials of the paper's Tables III and IV, or some of them."""
        return [
            self.trial(current, sign * speed, seed)
            for sign in signs
            for speed in speeds
            for current in currents
        ]
