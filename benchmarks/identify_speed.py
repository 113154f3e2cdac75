"""Output error: CPU time of a whole identification; one fit against two scipy baselines.

    python benchmarks/identify_speed.py            about 3 minutes
    python benchmarks/identify_speed.py --full     runs the solve_ivp baseline on all trials

All three fits see the same samples, whitening, priors and start. One baseline is scipy's
least_squares over solve_ivp with differences, the other least_squares over rigd's own compiled
recursion with differences. What cannot be run whole is projected, and marked so.
"""

from __future__ import annotations

import argparse
import math
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from figures import at_least, at_most, noted
from identify_data import FLOORS, record
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from rigd.analysis.fitting.fit import fit, multi_start
from rigd.analysis.fitting.model import scaled_bounds, to_natural, to_scaled
from rigd.analysis.output_error.thresholds import THRESHOLDS
from rigd.analysis.output_error.whitened_residuals import OutputErrorModel, noise_at
from rigd.analysis.recordings.source import open_sweep
from rigd_analyses.lugre.conclusion import identify_output_error
from rigd_analyses.lugre.model import LugreModel
from rigd_analyses.lugre.reading import arrays, rig_constants
from rigd_analyses.lugre.rig.family import rig_system
from rigd_analyses.lugre.rig.outputs import DYNAMIC, WHEEL_DELAY, outputs
from rigd_analyses.lugre.rig.parts import sort_out
from rigd_analyses.lugre.rig.system import RigSystem
from rigd_analyses.lugre.slip_force.identify import Settings
from rigd_analyses.lugre.trials.known_constants import RigConstants
from rigd_analyses.lugre.trials.slip_and_traction import process
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial, sampling_period_s

FloatArray = NDArray[np.float64]
STARTS = 8
FLOOR_S, ALL_FLOORS_S = 10.0, 15.0
IVP_RATIO, COMPILED_RATIO = 1000, 4
RTOL, ATOL, DIFF_STEP = 1e-8, 1e-10, 1e-4  #: as in identify_peer
Recorded = tuple[list[LugreTrial], LugreConstants, RigConstants]


def cpu_s(work: Callable[[], object]) -> float:
    """Return the CPU time of ``work`` in s."""
    start = time.process_time()
    work()
    return time.process_time() - start


def recorded(floor: str, folder: Path) -> Recorded:
    """Return the arrays of a fresh recording, and what its rig file knows."""
    seed = int.from_bytes(os.urandom(3), "little") + 1
    sweep = open_sweep(record(floor, seed, folder))
    used = [(sweep, trial) for trial in sweep.trials]
    trials, constants = arrays(used)
    return trials, constants, rig_constants(used, constants)


def solved_outputs(system: RigSystem, trial: int, shared: FloatArray, local: FloatArray) -> object:
    """Return the outputs (n, 3) of one trial by solve_ivp, current and angle interpolated."""
    q = [float(x) for x in (*shared[:DYNAMIC], local[0])]
    v_s, mu_c, static, s_0, s_1, s_2 = q[0], q[1], q[1] * math.exp(q[2]), q[3], q[4], q[5]
    driven, constants = system.trials[trial], system.constants
    mass, normal = constants.mass.value, constants.normal_force_n
    turned = driven.angle_rad + shared[WHEEL_DELAY] * driven.turning_rad_s
    phase = constants.roller_transitions * turned
    current, phases = driven.current_a.tolist(), phase.tolist()
    period, last = system.period_s, len(current) - 1

    def rate(t: float, y: FloatArray) -> list[float]:
        _, _, v, w, z = map(float, y)
        at = t / period
        k = min(int(at), last - 1)
        share = at - k
        i = current[k] + share * (current[k + 1] - current[k])
        a = phases[k] + share * (phases[k + 1] - phases[k])
        slip = q[14] * w - v
        g = mu_c + (static - mu_c) * math.exp(-math.sqrt(abs(slip) / v_s))
        u = slip - abs(slip) * z / g
        force = normal * (z + s_1 * u + s_2 * slip)
        resistance = (q[10] + q[11] * normal) * math.tanh(v / 1e-3)
        ripple = v * (q[16] * math.cos(a) + q[17] * math.sin(a))
        torque = q[6] * (i + q[15]) - q[7] * math.tanh(q[14] * w / 1e-3) - q[8] * w
        return [
            v, w, (force - resistance - q[12] * v) / mass - q[13] + ripple,
            (torque - q[14] * force) / q[9], s_0 * u,
        ]  # fmt: skip

    t = np.arange(last + 1) * period
    y = solve_ivp(rate, (0.0, t[-1]), [0, 0, 0, 0, q[18]], "LSODA", t, rtol=RTOL, atol=ATOL).y
    rates = np.array([rate(float(s), y[:, k])[2] for k, s in enumerate(t)])
    states = np.stack([y[0], y[1], rates, y[2], y[3], y[4]], axis=1)
    return outputs(states, phase, shared, local, constants.wheel_radius.value, period)


def against_scipy(floor: str, system: RigSystem, *, full: bool) -> None:
    """Compare one start of rigd's fit with one of scipy's."""
    unknowns = [*system.shared, *(item for _ in system.trials for item in system.local)]
    start = np.array([item.parameter.start for item in unknowns])
    model = OutputErrorModel(system, noise_at(system, start))
    ours = fit(model, start, relative_decrease=THRESHOLDS.min_decrease)
    mine = min(
        cpu_s(lambda: fit(model, start, relative_decrease=THRESHOLDS.min_decrease))
        for _ in range(3)
    )

    count = 0

    def residual(scaled: FloatArray) -> FloatArray:
        nonlocal count
        count += 1
        return model.residuals(to_natural(model.parameters, scaled))

    low, high = scaled_bounds(model.parameters)
    begin = np.clip(to_scaled(model.parameters, start), low + 1e-9, high - 1e-9)
    clock = time.process_time()
    peer = least_squares(
        residual, begin, bounds=(low, high), x_scale="jac", ftol=THRESHOLDS.min_decrease
    )
    compiled = time.process_time() - clock
    trials = range(model.trials) if full else (model.trials // 2,)
    shared = len(system.shared)

    def solved() -> None:
        for k in trials:
            here = model.columns(k)
            solved_outputs(system, k, ours.theta[here[:shared]], ours.theta[here[shared:]])

    samples = sum(len(system.measured[k]) for k in trials)
    each = cpu_s(solved) * sum(len(part) for part in system.measured) / samples
    print(
        f"{floor}: {len(model.mask)} residuals, {len(model.parameters)} parameters\n"
        f"  rigd                      {mine:8.2f} s, {ours.evaluations} evaluations, cost "
        f"{ours.cost:.1f}\n"
        f"  scipy, compiled recursion {compiled:8.2f} s MEASURED, {count} residuals, cost "
        f"{peer.cost:.1f}\n"
        f"  scipy, solve_ivp          {count * each:8.0f} s PROJECTED: as many residuals of "
        f"{each:.2f} s (LSODA, rtol {RTOL:g}, {len(trials)} of {model.trials} trials solved)"
    )
    at_least(f"{floor}: one fit, scipy with solve_ivp projected / rigd", count * each / mine,
             IVP_RATIO)  # fmt: skip
    at_least(f"{floor}: one fit, scipy with compiled recursion / rigd", compiled / mine,
             COMPILED_RATIO)  # fmt: skip
    at_most(f"{floor}: cost, rigd / scipy", ours.cost / peer.cost, 1.001)


def main() -> None:
    """Time every floor whole, then one fit beside its baselines."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--full", action="store_true", help="solve_ivp on all trials")
    parser.add_argument("--floor", action="append", choices=FLOORS)
    options = parser.parse_args()
    settings = Settings(starts=STARTS)
    together = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for floor in options.floor or FLOORS:
            trials, constants, rig = recorded(floor, Path(folder))

            def whole(trials=trials, constants=constants, rig=rig) -> object:  # type: ignore[no-untyped-def]
                return identify_output_error(trials, constants, rig, settings)

            if together == 0.0:
                whole()  # compiles, or loads what is compiled
            spent = min(cpu_s(whole) for _ in range(2))
            together += spent
            at_most(f"{floor}: output error whole, {STARTS} starts", spent, FLOOR_S, "s CPU")
            periods = [sampling_period_s(trial) for trial in trials]
            parts, _ = sort_out(trials, periods, settings)
            sweep = process([trial for trial, _ in parts], constants, settings.guards)
            by_force = LugreModel([trial.samples for trial in sweep.trials])
            begin = multi_start(by_force, starts=STARTS, seed=1)[0].theta
            system = rig_system(parts, rig, begin)
            against_scipy(floor, system, full=options.full)
    noted("the floors together", together, "s CPU")
    at_most("the floors together", together, ALL_FLOORS_S, "s CPU")


if __name__ == "__main__":
    main()
