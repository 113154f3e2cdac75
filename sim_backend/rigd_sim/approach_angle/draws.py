"""Draws the random differences between approach-angle rigs, between loads, and between runs."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rigd_sim.approach_angle.parameters import AngleParameters

#: What a seed is drawn for: series of different purposes never share a number.
_RIG, _LOAD, _RUN = 1, 2, 3


@dataclass(frozen=True)
class Individual:
    """How one rig differs from its drawing; the default is the rig as drawn."""

    gain_a: float = 1.0  #: true over nominal, gauge a and its amplifier
    gain_b: float = 1.0
    rigidity: float = 1.0  #: true over nominal torsional rigidity
    gauge_phase: float = 0.0  #: where the gauges stand at the wheel's start, rad
    wheel_slope: float = 1.0  #: true over nominal slope of the potentiometers
    wheel_phase: float = 0.0  #: of the error once per turn, rad
    platform_slope: float = 1.0
    platform_phase: float = 0.0
    scale_gain: float = 1.0
    load_cell_gain: float = 1.0
    load_cell_zero_v: float = 0.0
    arm_deviation_m: float = 0.0  #: true minus nominal length of the calibration arm
    profile_phase: float = 0.0  #: of the wheel's profile at its start, rad


@dataclass(frozen=True)
class Run:
    """How one run differs from the next; the default is a run without scatter."""

    surface: float = 1.0  #: true over published friction limit
    rise: float = 0.0  #: relative rise of the normal force up to the stop
    drift_a: float = 0.0  #: zero of the gauges, strain
    drift_b: float = 0.0
    wheel_offset: float = 0.0  #: start of the wheel's potentiometer beyond nominal, rad
    platform_offset: float = 0.0  #: start of the platform's beyond nominal, m
    gap: float = 0.0  #: where the rotor stands in the backlash, -1 to 1


def individual(parameters: AngleParameters, number: int) -> Individual:
    """Return the rig with this number, drawn from the tolerances."""
    p, random = parameters, np.random.default_rng((_RIG, number))

    def spread(sd: float) -> float:
        return float(random.normal(0.0, sd)) if sd > 0.0 else 0.0

    def phase() -> float:
        return float(random.uniform(0.0, 2 * math.pi))

    return Individual(
        gain_a=1.0 + spread(p.gauges.gain_spread),
        gain_b=1.0 + spread(p.gauges.gain_spread),
        rigidity=1.0 + spread(p.shaft.rigidity_spread),
        gauge_phase=phase(),
        wheel_slope=1.0 + spread(p.potentiometers.slope_spread),
        wheel_phase=phase(),
        platform_slope=1.0 + spread(p.potentiometers.slope_spread),
        platform_phase=phase(),
        scale_gain=1.0 + spread(p.scale.gain_spread),
        load_cell_gain=1.0 + spread(p.load_cell.gain_spread),
        load_cell_zero_v=spread(p.load_cell.zero_spread),
        arm_deviation_m=spread(p.calibration_arm.length_spread),
        profile_phase=phase(),
    )


def load_scatter(parameters: AngleParameters, seed: int, count: int) -> float:
    """Return the true over the announced load, as the ``count``-th setting of bolts gave it."""
    random = np.random.default_rng((_LOAD, seed, count))
    return 1.0 + parameters.normal_force.setting_spread * float(random.normal())


def run(parameters: AngleParameters, seed: int, count: int) -> Run:
    """Return the scatter of the run after the platform was pushed back ``count`` times."""
    p, random = parameters, np.random.default_rng((_RUN, seed, count))
    surface, rise, both, alone_a, alone_b, wheel, platform = random.normal(size=7).tolist()
    together = math.sqrt(p.gauges.drift_correlation) * both
    apart = math.sqrt(1.0 - p.gauges.drift_correlation)
    return Run(
        surface=1.0 + p.contact.scatter * surface,
        rise=p.normal_force.rise + p.normal_force.rise_spread * rise,
        drift_a=p.gauges.drift * (together + apart * alone_a),
        drift_b=p.gauges.drift * (together + apart * alone_b),
        wheel_offset=p.potentiometers.wheel_start_spread * wheel,
        platform_offset=p.potentiometers.platform_start_spread * platform,
        gap=float(random.uniform(-1.0, 1.0)),
    )
