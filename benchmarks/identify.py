"""Identification of the LuGre rig: speed against scipy, time of a whole floor, honest intervals.

python benchmarks/identify.py                       about 5 minutes
python benchmarks/identify.py --full                runs the scipy baseline whole (a minute)
python benchmarks/identify.py --rigs 100 --keep coverage.jsonl
                                                    in slices: stop it, start it again
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from figures import at_least, at_most, noted
from identify_coverage import study
from identify_data import FLOORS, record
from identify_peer import ATOL, DIFF_STEP, RTOL, fast_residual, peer_fit, slow_residual

from rigd.analysis.fitting.fit import Fit, fit
from rigd.analysis.recordings.source import open_sweep
from rigd_analyses.lugre.model import LugreModel
from rigd_analyses.lugre.reading import arrays
from rigd_analyses.lugre.slip_force.identify import Settings, identify_lugre
from rigd_analyses.lugre.trials.slip_and_traction import process
from rigd_analyses.lugre.trials.trial import LugreConstants, LugreTrial

ROUNDS = 7
STARTS = 8
TARGET_RATIO = 1000
TARGET_CPU_S = 2.0
#: Costs this close are the same: the rest is the distance of two fits on one flat bottom.
SAME_COST = 1.001


def cpu_s(work: Callable[[], object]) -> float:
    """Return the CPU time of ``work`` in s."""
    start = time.process_time()
    work()
    return time.process_time() - start


def recorded(floor: str, folder: Path) -> tuple[list[LugreTrial], LugreConstants]:
    """Return the arrays of a fresh recording."""
    seed = int.from_bytes(os.urandom(3), "little") + 1
    sweep = open_sweep(record(floor, seed, folder))
    return arrays([(sweep, trial) for trial in sweep.trials])


def against_scipy(floor: str, model: LugreModel, *, full: bool) -> None:
    """Compare one start of rigd's fit with one of scipy's, on the same samples and start."""
    ours = fit(model)  # loads the kernels
    peer = peer_fit(model, fast_residual(model))
    slow = slow_residual(model)
    fit_s, residual_s = [], []
    for _ in range(ROUNDS):
        fit_s.append(cpu_s(lambda: fit(model)))
        residual_s.append(cpu_s(lambda: slow(ours.theta)))
    mine, each = min(fit_s), min(residual_s)
    projected = peer.evaluations * each
    print(
        f"{floor}: {int(np.count_nonzero(model.mask))} samples of {len(model.trials)} currents\n"
        f"  rigd   {1e3 * mine:8.1f} ms, {ours.evaluations} evaluations, cost {ours.cost:.6f}\n"
        f"  scipy  {1e3 * projected:8.0f} ms PROJECTED: {peer.evaluations} evaluations, counted in "
        f"a whole least_squares fit on rigd's residual\n"
        f"         (cost {peer.cost:.6f}), times {1e3 * each:.0f} ms, measured, for one residual "
        f"by solve_ivp (LSODA, rtol {RTOL:g}, atol {ATOL:g};\n"
        f"         difference step {DIFF_STEP:g}: with scipy's default of 1.5e-8 the solver's own "
        "error is all it sees, and it stays at the start)"
    )
    at_least(f"{floor}: one start, scipy projected / rigd", projected / mine, TARGET_RATIO)
    at_most(f"{floor}: cost, rigd / scipy", ours.cost / peer.cost, SAME_COST)
    if full:
        _run_whole(floor, model, ours, mine)


def _run_whole(floor: str, model: LugreModel, ours: Fit, mine: float) -> None:
    start = time.process_time()
    peer = peer_fit(model, slow_residual(model))
    whole = time.process_time() - start
    cost = model.cost(peer.theta)
    print(
        f"  scipy  {1e3 * whole:8.0f} ms MEASURED, {peer.evaluations} evaluations, "
        f"cost {cost:.6f} (same residual as above at its end)"
    )
    at_least(f"{floor}: one start, scipy run whole / rigd", whole / mine, TARGET_RATIO)
    at_most(f"{floor}: cost, rigd / scipy run whole", ours.cost / cost, SAME_COST)


def whole_floor(floor: str, trials: list[LugreTrial], constants: LugreConstants) -> None:
    """Time method A with all it reports: filters, starts, profiles, jackknife, advice."""
    settings = Settings(starts=STARTS)
    identify_lugre(trials, constants, settings)
    times = [cpu_s(lambda: identify_lugre(trials, constants, settings)) for _ in range(3)]
    at_most(f"{floor}: method A whole, {STARTS} starts", min(times), TARGET_CPU_S, "s CPU")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="run the scipy baseline whole")
    parser.add_argument("--rigs", type=int, default=20, help="random rigs per floor (0: none)")
    parser.add_argument("--keep", type=Path, help="JSON lines of the coverage study, appended to")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for floor in FLOORS:
            trials, constants = recorded(floor, Path(folder))
            sweep = process(trials, constants)
            model = LugreModel([t.samples for t in sweep.trials])
            against_scipy(floor, model, full=options.full)
            whole_floor(floor, trials, constants)
    if options.rigs:
        start = time.process_time()
        study(options.rigs, options.keep)
        noted("coverage study", time.process_time() - start, "s CPU")


if __name__ == "__main__":
    main()
