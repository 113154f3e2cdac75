"""The golden runs: simulated by an independent implementation, with the results it got on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from rigd_analyses.approach_angle.raw.run_data import (
    AngleCalibration,
    AngleRig,
    AngleRun,
    FloatArray,
    Known,
)

FILE = Path(__file__).with_name("data") / "angle_golden.npz"
#: Loads in kg that the runs were made with; the file has the reading of the scale in N.
LOADS = {"r0": 4.0, "r2": 5.0, "r3": 6.0, "r5": 8.0}
PRE_S, AFTER_S, RATE_HZ = 0.1, 0.05, 9600.0


@dataclass(frozen=True)
class Golden:
    """One run as the file has it, from the command to the stop, and what must come out."""

    run: AngleRun
    expected: Mapping[str, float]

    @property
    def whole(self) -> AngleRun:
        """Return the run as a rig records it: with 0.1 s before the command, 50 ms after the stop.

        Before it stands at rest with noise of its own; after it stays as it was.
        """
        run, rng = self.run, np.random.default_rng(1)
        before, after = round(PRE_S * RATE_HZ), round(AFTER_S * RATE_HZ)

        def longer(volts: FloatArray, noise: float) -> FloatArray:
            rest = np.mean(volts[:48]) + noise * rng.standard_normal(before)
            return np.concatenate([rest, volts, np.full(after, volts[-1])])

        return replace(
            run,
            t_s=(np.arange(before + run.t_s.size + after) - before) / RATE_HZ,
            gauge_a_v=longer(run.gauge_a_v, 0.016),
            gauge_b_v=longer(run.gauge_b_v, 0.016),
            wheel_v=longer(run.wheel_v, 0.0015),
            platform_v=longer(run.platform_v, 0.0015),
        )


@pytest.fixture(scope="session")
def calibration() -> AngleCalibration:
    """Return the scales of the golden runs, taken as exact."""
    with np.load(FILE) as data:
        torque, wheel, platform, _ = (float(x) for x in data["cal"])
    return AngleCalibration(Known(torque), Known(wheel), Known(platform))


@pytest.fixture(scope="session")
def rig() -> AngleRig:
    """Return the rig of the golden runs."""
    return AngleRig(
        wheel_radius_m=0.05,
        wheel_inertia=4e-4,
        platform_mass_kg=3.0,
        gravity=9.81,
        effective_radius=Known(0.995, 0.001),
        bearing_constant=Known(0.012, 0.0012),
        bearing_viscous=Known(2e-4, 0.6e-4),
        bearing_load=Known(1e-4, 1e-5),
        rolling_resistance=Known(0.006, 0.0018),
        roller_drag=Known(0.05, 0.015),
        rail_constant=Known(0.6, 0.06),
        rail_load=Known(0.01, 0.001),
        rail_viscous=Known(0.3, 0.03),
    )


@pytest.fixture(scope="session")
def golden() -> Callable[[str], Golden]:
    """Return the reader of golden runs: ``golden("r0")``."""

    @cache
    def read(name: str) -> Golden:
        with np.load(FILE) as data:
            raw = {
                key.removeprefix(f"{name}_"): data[key]
                for key in data.files
                if key.startswith(f"{name}_")
            }
        run = AngleRun(
            label=name,
            set_name=name,
            alpha_rad=float(raw["alpha"]),
            announced_load_kg=LOADS[name],
            voltage_v=10.0,
            repeat=1,
            t_s=raw["t"],
            gauge_a_v=raw["ga"],
            gauge_b_v=raw["gb"],
            wheel_v=raw["pw"],
            platform_v=raw["px"],
            stop_s=float(raw["t"][-1]),
            load_n=float(raw["N_read"]),
        )
        expected = {k.removeprefix("exp_"): float(v) for k, v in raw.items() if "exp_" in k}
        return Golden(run, expected)

    return read
