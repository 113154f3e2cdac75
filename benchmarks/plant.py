"""Speed of the simulated LuGre rig: the compiled integrator beside the same scheme in C.

Both run the same random drives, one after the other in every round, so that a busy machine slows
both. Then the whole cycle: one advance with all readings, and seven devices read and written.

    python benchmarks/plant.py
"""

from __future__ import annotations

import ctypes
import os
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from compiled import FLAGS, compiled
from figures import at_most
from numpy.typing import NDArray

from rigd.sdk import Driver
from rigd_sim.lugre import kernel, records
from rigd_sim.lugre.amplifier import AmplifierConfig, LugreAmplifier
from rigd_sim.lugre.belt import BeltConfig, LugreBelt
from rigd_sim.lugre.plant import LugreConfig, LugrePlant
from rigd_sim.lugre.sensors import (
    AccelerometerConfig,
    EncoderConfig,
    LugreAccelerometer,
    LugreEncoder,
    LugreTruth,
)

SOURCE = Path(__file__).with_name("plant_reference.c")
STEP_S = 125e-6
CYCLE_STEPS = 8
CYCLES = 1000  # one simulated second a round
ROUNDS = 41
TARGET_RATIO = 1.3
TARGET_US = 5.0

Rows = NDArray[np.void]
Integrate = Callable[[Rows, Rows, Rows, float, int], None]


def compiled_reference() -> Integrate:
    """Return the integrator of the C file."""
    layout = {
        "constants": records.CONSTANTS,
        "state": records.STATE,
        "commands": records.COMMANDS,
    }
    arguments = [ctypes.c_void_p] * 3 + [ctypes.c_double, ctypes.c_long]
    function = compiled(SOURCE, layout, arguments)

    def integrate(constants: Rows, state: Rows, commands: Rows, step: float, steps: int) -> None:
        function(constants.ctypes.data, state.ctypes.data, commands.ctypes.data, step, steps)

    return integrate


def second(integrate: Integrate, constants: Rows, commands: Rows) -> tuple[float, Any]:
    """Return the CPU time of one simulated second from rest, in ns a step, and the state."""
    state = records.state_at_rest()
    steps = CYCLES * CYCLE_STEPS
    start = time.perf_counter_ns()
    integrate(constants, state, commands, STEP_S, steps)
    return (time.perf_counter_ns() - start) / steps, state.view(np.float64)


def compare(name: str, integrate_c: Integrate, *, vibration: bool, lateral: bool) -> None:
    random = np.random.default_rng()
    parameters = LugreConfig().read_parameters()
    times: list[tuple[float, float]] = []
    worst = 0.0
    for _ in range(ROUNDS):
        floor = getattr(parameters.floors, random.choice(["stone", "pvc", "paperboard"]))
        constants = records.constants(parameters, floor, 3.9593, noise=True, vibration=vibration)
        commands = np.zeros(1, records.COMMANDS)
        commands["wheel_enabled"], commands["wheel_current"] = 1.0, random.uniform(0.6, 1.5)
        commands["lateral_engaged"] = float(lateral)
        commands["lateral_speed"] = random.uniform(0.2, 0.5) if lateral else 0.0
        ours, result = second(kernel.integrate, constants, commands)
        theirs, reference = second(integrate_c, constants, commands)
        times.append((ours, theirs))
        scale = np.maximum(np.abs(reference), 1e-3)
        worst = max(worst, float(np.max(np.abs(result - reference) / scale)))
    ours, theirs = (statistics.median(column) for column in zip(*times, strict=True))
    ratio = statistics.median(a / b for a, b in times)
    verdict = "ok" if ratio <= TARGET_RATIO else "SLOW"
    print(
        f"{name:<22}{ours:>10.1f}{theirs:>10.1f}{1e3 / ours:>12.1f}{1e3 / theirs:>12.1f}"
        f"{ratio:>8.2f}  {verdict:<5}{1e9 / (ours * CYCLES * CYCLE_STEPS):>9.0f}x{worst:>12.1e}"
    )
    at_most(f"plant kernel / C -O3, {name}", ratio, TARGET_RATIO)


def cycle() -> None:
    """Print what one cycle of 1 ms costs in the plant and with all devices on it."""
    plant = LugrePlant(LugreConfig(), period_ns=1_000_000, seed=1)
    amplifier = LugreAmplifier(AmplifierConfig(), plant)
    along = LugreBelt(BeltConfig(axis="longitudinal"), plant)
    across = LugreBelt(BeltConfig(axis="lateral"), plant)
    devices: list[Driver] = [
        amplifier,
        along,
        across,
        LugreEncoder(EncoderConfig(axis="wheel"), plant),
        LugreEncoder(EncoderConfig(axis="carriage"), plant),
        LugreAccelerometer(AccelerometerConfig(), plant),
        LugreTruth(LugreTruth.Config(), plant),
    ]
    for device in devices:
        device.arm()
    alone, whole, t_ns = [], [], 0
    for _ in range(ROUNDS):
        start = time.perf_counter_ns()
        for _ in range(CYCLES):
            t_ns += 1_000_000
            plant.advance(t_ns)
        alone.append((time.perf_counter_ns() - start) / CYCLES / 1e3)
        start = time.perf_counter_ns()
        for _ in range(CYCLES):
            t_ns += 1_000_000
            for device in devices:
                device.read(t_ns)
            amplifier.write((0.4,))
            along.write((0.0, 1.0))
            across.write((0.0, 1.0))
        whole.append((time.perf_counter_ns() - start) / CYCLES / 1e3)
    advance = statistics.median(alone)
    at_most("plant, advance with readings", advance, TARGET_US, "us a cycle")
    print(f"with seven devices     {statistics.median(whole):6.2f} us a cycle")


def main() -> None:
    integrate_c = compiled_reference()
    print(
        f"C: {os.environ.get('CC', 'cc')} {' '.join(FLAGS[:2])}; medians of {ROUNDS} rounds of 1 s"
    )
    print(
        f"{'':<22}{'ns/step':>10}{'C':>10}{'Msteps/s':>12}{'C':>12}{'ratio':>8}  {'':<5}"
        f"{'real time':>10}{'difference':>12}"
    )
    compare("longitudinal", integrate_c, vibration=False, lateral=False)
    compare("with vibration", integrate_c, vibration=True, lateral=False)
    compare("with lateral motion", integrate_c, vibration=True, lateral=True)
    cycle()


if __name__ == "__main__":
    main()
