"""The thresholds of a lateral sweep; a field is named by its kind, with its unit at the end."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LateralThresholds:
    """Where a lateral sweep is taken as usable, its couplings as told apart, its fits as ended."""

    # -- Trials --
    #: Share of its mean by which the lateral speed may differ during a drive.
    max_unsteady_share: float = 0.25
    #: Faster lateral motion is that of a bridge that moves.
    min_speed_m_s: float = 0.01
    #: Two currents that differ by no more are one.
    max_apart_a: float = 0.02
    #: Fastest over slowest lateral speed below which both are one.
    max_speed_ratio: float = 1.1

    # -- Couplings --
    #: That a turned lateral speed must gain to be accepted, and by which one of two couplings is
    #: preferred: a factor of 150 in the likelihood.
    min_gain_ln_l: float = 5.0
    #: By which another choice, or optimum, is so much worse that it is not fitted.
    max_behind_ln_l: float = 30.0
    #: Of one false alarm in the tests of all constants that the result rests on: half the lever,
    #: which halves the friction, shows itself with 0.017.
    max_p_value_coupling: float = 0.019
    #: Gain of the loop of Eqs. 22, 25 and 26, of which is warned; at 1 the rollers lock.
    max_loop_gain: float = 0.9

    # -- The fit ends --
    #: A round that gains less is the last.
    min_gain_round_ln_l: float = 0.02
    #: What ends a fit of the coupling within a round.
    min_gain_coupling_ln_l: float = 1e-3
    #: And one from a start of many.
    min_gain_start_ln_l: float = 1e-2
    #: Optima that are worse by no more have starts around them.
    max_behind_start_ln_l: float = 10.0
    #: Of an uncertainty, or of this: two ends are one optimum.
    max_distance_one_optimum: float = 0.2
    #: Times the threshold of a profile: optima up to there are followed.
    max_followed: float = 4.0


LATERAL = LateralThresholds()
