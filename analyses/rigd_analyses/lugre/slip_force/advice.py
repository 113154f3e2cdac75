"""Proposes further tests that would help; each is simulated from the slip already recorded.

The recordings show what the drive can reach. With half the carriage mass it reaches two times that
slip (the noise of F/F_N stays the same and the slip grows as 1/m; lugre.md section 5). The module
proposes only tests that this method can evaluate: one constant current each.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rigd.analysis.fitting.identifiability import Candidate
from rigd.analysis.friction import SlipForce
from rigd.analysis.result import FloatArray
from rigd_analyses.lugre.model import LugreModel

#: Parameters that no excitation within reach of the drive determines, and why (lugre.md section 5).
OUT_OF_REACH = {
    "V_s": "It needs slip both well below V_s and up to V_s itself, which is a stronger drive or a "
    "much lighter carriage; more of the same tests do not help.",
    "mu_c": "It needs slip well beyond V_s, so that the Stribeck effect has died away: a stronger "
    "drive or a lighter carriage.",
    "mu_s": "It needs slow, constant slip near break-away: constant currents just above the one "
    "that moves the carriage, or slow current ramps.",
    "mu_s-mu_c": "It needs the same test both far below and far above V_s.",
}
SMOOTHED = (
    "The bias comes with the smoothing, not with the tests: no recording evaluated by this method "
    "removes it."
)


def candidates(trials: Sequence[SlipForce], visited_m_s: float) -> tuple[Candidate, ...]:
    """Return what could be recorded next, each as a model of its slip and mask."""
    return (
        Candidate(
            "The same currents with half the carriage mass",
            LugreModel([_scaled(t, 2.0) for t in trials]),
        ),
        Candidate(
            "Slow constant currents near break-away, three tests",
            LugreModel([_constant(t, visited_m_s * share) for t, share in _slow(trials)]),
        ),
        Candidate(
            "The same tests four times over", LugreModel([t for t in trials for _ in range(3)])
        ),
    )


def _scaled(trial: SlipForce, factor: float) -> SlipForce:
    return _with_slip(trial, factor * trial.slip_m_s)


def _constant(trial: SlipForce, slip_m_s: float) -> SlipForce:
    slip = np.full(len(trial.slip_m_s), slip_m_s)
    slip[0] = 0.0
    return _with_slip(trial, slip)


def _slow(trials: Sequence[SlipForce]) -> list[tuple[SlipForce, float]]:
    return list(zip(trials[:3], (0.02, 0.05, 0.1), strict=True))


def _with_slip(trial: SlipForce, slip: FloatArray) -> SlipForce:
    return SlipForce(trial.label, trial.period_s, slip, np.zeros_like(slip), np.ones_like(slip))
