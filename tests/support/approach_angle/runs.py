"""Simulated runs of the approach-angle rig as the analyses take them, and the truth beside them.

The plant's own constants are known to the analysis only as well as a calibration finds them: each
is off by a draw from its standard uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from support.approach_angle.headless import SimulatedRun, simulate

from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRig,
    AngleRun,
    Known,
    KnownRun,
)

SETS = ("clean_0", "clean_15", "clean_30", "clean_45", "coated_0")
LOADS_KG = (4.0, 5.0, 6.0, 8.0)
VOLTAGES_V = (4.0, 5.5, 7.0, 8.5, 10.0)
REPEATS = 2
#: Table 1 of the paper, which the plant's limits of friction are set to.
TABLE_1 = {
    "clean_0": 0.1868, "clean_15": 0.2475, "clean_30": 0.4504, "clean_45": 0.5861,
    "coated_0": 0.4430,
}  # fmt: skip
GRAVITY = 9.81


@dataclass(frozen=True)
class Trial:
    """A run, what is known of it, and what really happened."""

    known: KnownRun
    simulated: SimulatedRun


def drawn_rig(seed: int) -> AngleRig:
    """Return a calibration of the plant with errors drawn by ``seed`` (0: no errors)."""
    rng = np.random.default_rng(seed)

    def found(true: float, relative_u: float) -> Known:
        error = relative_u * rng.standard_normal() if seed else 0.0
        return Known(true * (1.0 + error), true * relative_u)

    return AngleRig(
        wheel_radius_m=0.05,
        wheel_inertia=4e-4,
        platform_mass_kg=3.0,
        gravity=GRAVITY,
        effective_radius=found(0.995, 0.002),
        bearing_constant=found(0.012, 0.12),
        bearing_viscous=found(2e-4, 0.2),
        bearing_load=found(1e-4, 0.2),
        rolling_resistance=found(0.006, 0.3),
        roller_drag=found(0.05, 0.2),
        rail_constant=found(0.6, 0.1),
        rail_load=found(0.010, 0.1),
        rail_viscous=found(0.3, 0.1),
        load_rise=found(0.1, 0.16),
    )


def trial(
    set_name: str, load_kg: float, voltage_v: float, repeat: int, number: int, *,
    rig: AngleRig, seed: int, individual: int = 1, rubbing_nm: float = 0.0,
    load_cell: bool = False, noise: bool = True, drag: bool = True, fault: str = "none",
) -> Trial:  # fmt: skip
    """Simulate one run."""
    done = simulate(
        set_name, load_kg, voltage_v, seed=seed, individual=individual, rubbing_nm=rubbing_nm,
        load_cell=load_cell, noise=noise, drag=drag, fault=fault,
    )  # fmt: skip
    return Trial(known_run(done, rig, repeat, number), done)


def known_run(done: SimulatedRun, rig: AngleRig, repeat: int, number: int) -> KnownRun:
    """Return a simulated run as the analysis takes it, with the calibration of its sensors."""
    load_cell = done.normal_force_v is not None
    cell = Known(done.normal_force_scale, 0.003 * done.normal_force_scale) if load_cell else None
    calibration = AngleCalibration(
        torque=Known(done.torque_scale, 0.0025 * abs(done.torque_scale)),
        wheel=Known(done.wheel_scale, 0.002 * done.wheel_scale),
        platform=Known(done.platform_scale, 0.002 * done.platform_scale),
        load=Known(1.0, 0.002),
        normal_force=cell,
        normal_force_zero=Known(done.normal_force_zero_v if load_cell else 0.0),
    )
    run = AngleRun(
        label=f"{done.set_name} {done.announced_load_kg:g} kg {done.voltage_v:g} V #{repeat}",
        set_name=done.set_name,
        wheel=done.set_name.partition("_")[0],
        alpha_rad=done.alpha_rad,
        announced_load_kg=done.announced_load_kg,
        voltage_v=done.voltage_v,
        repeat=repeat,
        t_s=done.t_s,
        gauge_a_v=done.gauge_a_v,
        gauge_b_v=done.gauge_b_v,
        wheel_v=done.wheel_v,
        platform_v=done.platform_v,
        stop_s=done.stop_s,
        load_n=done.scale_kg * GRAVITY,
        load_stable=done.scale_stable,
        normal_force_v=done.normal_force_v,
        number=number,
    )
    return KnownRun(run, calibration, rig)


def campaign(
    *, seed: int, individual: int = 1, sets: Sequence[str] = SETS,
    loads_kg: Sequence[float] = LOADS_KG, voltages_v: Sequence[float] = VOLTAGES_V,
    repeats: int = REPEATS, load_cell: bool = False,
) -> Iterator[Trial]:  # fmt: skip
    """Simulate a campaign on one rig; the calibration's errors are drawn from ``seed`` too."""
    rig, number = drawn_rig(1000 * seed + individual), 0
    for set_name in sets:
        for load_kg in loads_kg:
            for voltage_v in voltages_v:
                for repeat in range(1, repeats + 1):
                    number += 1
                    yield trial(
                        set_name, load_kg, voltage_v, repeat, number, rig=rig,
                        seed=100_000 * seed + number, individual=individual, load_cell=load_cell,
                    )  # fmt: skip
