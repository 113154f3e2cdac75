"""Speed of the simulated articulated robot, beside plain C and beside the paper's own formulation.

The compiled integrator and the same scheme in C run the same random drives, one after the other in
every round, so that a busy machine slows both. Then the straightforward way: `solve_ivp` on the 30
coordinates with their multipliers, at a tolerance that gives the accuracy of the fixed step. Last
the identification of both sets of tests, from recordings to numbers, without a report. All times
are CPU times of this process.

    python benchmarks/articulated.py
"""

from __future__ import annotations

import ctypes
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from compiled import FLAGS, compiled
from figures import at_least, at_most, noted
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from support.articulated.multipliers import Multipliers
from support.articulated.robots import Driven, chain, shipped

from rigd.analysis.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, perform
from rigd.engine.play.control import Control
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.sdk import Driver
from rigd.sdk.shipped_files import shipped_folder
from rigd_sim.articulated import kernel, records
from rigd_sim.articulated.drive import ArticulatedDrive, DriveConfig
from rigd_sim.articulated.parameters import ArticulatedParameters
from rigd_sim.articulated.plant import ArticulatedConfig, ArticulatedPlant
from rigd_sim.articulated.sensors import (
    ArticulatedTracker,
    ArticulatedTruth,
    ModuleConfig,
    TruthConfig,
)

SOURCE = Path(__file__).with_name("articulated_reference.c")
STEP_S = 5e-4
STEPS = 4000  # two simulated seconds a round
ROUNDS = 41
#: Of the equations of motion with multipliers, in s: what it takes is some 3 s for each.
STRAIGHT_S = 0.5
MOST_RATIO = 1.3
LEAST_RATIO = 300.0
MOST_US = 5.0
MOST_IDENTIFY_S = 5.0

Floats = NDArray[np.float64]
Integrate = Callable[[Driven], None]


def compiled_reference() -> Integrate:
    """Return the integrator of the C file."""
    layout = {"constants": records.ROBOT, "module": records.MODULES, "spin": records.SPINS}
    arguments = [ctypes.c_void_p] * 10 + [ctypes.c_double] + [ctypes.c_long] * 4
    function = compiled(SOURCE, layout, arguments)

    def integrate(it: Driven) -> None:
        arrays = (*it.robot, it.commands, it.state, it.slides, it.scratch)
        places = [array.ctypes.data for array in arrays]
        function(*places, STEP_S, STEPS, it.n, it.m, len(it.state))

    return integrate


def ours(it: Driven) -> None:
    """Integrate by the kernel."""
    kernel.integrate(
        it.robot, it.commands, it.state, it.slides, it.scratch, it.track, 0, STEP_S, STEPS, True
    )


def timed(integrate: Integrate, it: Driven) -> float:
    """Return the CPU time of the steps in ns each."""
    start = time.process_time_ns()
    integrate(it)
    return (time.process_time_ns() - start) / STEPS


def compare(
    name: str, reference: Integrate, parameters: ArticulatedParameters, law: str, fast: bool
) -> None:
    random = np.random.default_rng()
    times: list[tuple[float, float]] = []
    worst = 0.0
    for number in range(ROUNDS):
        robots = [Driven(parameters, law), Driven(parameters, law)]
        targets = random.uniform(300.0, 500.0, 2) if fast else random.uniform(80.0, 220.0, 2)
        for robot in robots:
            robot.commands[robot.driven, 1] = 1.0
            robot.commands[robot.driven, 0] = targets
        if number % 2:  # neither is always the second, which finds the memory warm
            second = timed(reference, robots[1])
            first = timed(ours, robots[0])
        else:
            first, second = timed(ours, robots[0]), timed(reference, robots[1])
        times.append((first, second))
        worst = max(worst, float(np.max(np.abs(robots[0].state - robots[1].state))))
    mine, theirs = (statistics.median(column) for column in zip(*times, strict=True))
    ratio = statistics.median(a / b for a, b in times)
    print(
        f"{name:<26}{mine:>9.0f}{theirs:>9.0f}{ratio:>8.2f}"
        f"{1e9 * STEP_S / mine:>9.0f}x{1e9 * STEP_S / theirs:>9.0f}x{worst:>12.1e}"
    )
    at_most(f"robot kernel / C -O3, {name}", ratio, MOST_RATIO)


def straightforward() -> None:
    """Compare with `solve_ivp` on 30 coordinates and multipliers, over the same start."""
    targets = np.array([80.0, 40.0])
    rate, start = Multipliers(shipped()).start(targets)
    began = time.process_time()
    end = solve_ivp(rate, (0.0, STRAIGHT_S), start, method="RK45", rtol=1e-6, atol=1e-9).y[:6, -1]
    theirs = time.process_time() - began
    spent = []
    for _ in range(20):
        robot = Driven()
        began = time.process_time()
        robot.play(STRAIGHT_S, *targets)
        spent.append(time.process_time() - began)
    found = np.column_stack([robot.centres, robot.headings]).ravel()
    ratio = theirs / statistics.median(spent)
    print(
        f"\nsolve_ivp on 30 coordinates: {theirs:.2f} s of CPU for {STRAIGHT_S} s; poses differ by "
        f"{np.abs(found - end).max():.1e}"
    )
    at_least("robot, solve_ivp on 30 coordinates / kernel", ratio, LEAST_RATIO)


def cycle() -> None:
    """Print what one cycle of 1 ms costs in the plant and with all devices on it."""
    plant = ArticulatedPlant(ArticulatedConfig(), period_ns=1_000_000, seed=1)
    motors = [
        ArticulatedDrive(DriveConfig(module="front", wheel=wheel), plant)
        for wheel in ("front_right", "front_left")
    ]
    sensors: list[Driver[Any, Any]] = [
        *(ArticulatedTracker(ModuleConfig(module=name), plant) for name in plant.modules),
        *(
            ArticulatedTruth(TruthConfig.model_validate({"module": name, "period": "10 ms"}), plant)
            for name in plant.modules
        ),
    ]
    for device in (*motors, *sensors):
        device.open()
        device.arm()
    alone, whole, t_ns = [], [], 0
    for _ in range(ROUNDS):
        start = time.process_time_ns()
        for _ in range(500):
            t_ns += 1_000_000
            plant.advance(t_ns)
        alone.append((time.process_time_ns() - start) / 500e3)
        start = time.process_time_ns()
        for _ in range(500):
            t_ns += 1_000_000
            for device in (*motors, *sensors):
                device.read(t_ns)
            for motor in motors:
                motor.write((200.0,))
        whole.append((time.process_time_ns() - start) / 500e3)
    at_most("robot, advance with feedback", statistics.median(alone), MOST_US, "us a cycle")
    noted("robot, with six devices", statistics.median(whole), "us a cycle")


def identification() -> None:
    """Print how long the fit of the 19 trials of both sets takes, once all is compiled."""
    rig = load_rig(shipped_folder("configs") / "sim_articulated.yaml")
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for name in ("straight_speeds", "circles"):
            source = load_procedure(shipped_folder("procedures") / f"{name}.yaml")
            procedure = compile_procedure(source, rig, {})
            paths.append(Path(folder) / f"{name}.mcap")
            perform(RunRequest(procedure, source.file.text, rig, 1, output=paths[-1]), Control())
        evaluate(paths, Options())
        began = time.process_time()
        evaluate(paths, Options())
        spent = time.process_time() - began
    at_most("robot, identification of 19 trials", spent, MOST_IDENTIFY_S, "s")


def main() -> None:
    reference = compiled_reference()
    print(
        f"C: {os.environ.get('CC', 'cc')} {' '.join(FLAGS[:2])}; medians of {ROUNDS} rounds of 2 s"
    )
    print(f"{'':<26}{'ns/step':>9}{'C':>9}{'ratio':>8}{'real time':>10}{'C':>10}{'difference':>12}")
    compare("two modules", reference, shipped(), "paper", fast=False)
    compare("two modules, sliding", reference, shipped(), "paper", fast=True)
    compare("two modules, smooth law", reference, shipped(), "smooth", fast=True)
    compare("five modules", reference, chain(5), "paper", fast=False)
    straightforward()
    cycle()
    identification()


if __name__ == "__main__":
    main()
