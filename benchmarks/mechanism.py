"""Speed of a rig whose plant is a file: the compiled integrator beside the same scheme in C.

Both take the same steps, one after the other in every round, so that a busy machine slows both.
Then a rig of eight elements from end to end: engine, interlocks, plant and recording, at a cycle of
1 kHz, with the step of the default and a longer one, and of 100 Hz. Before each its plant alone:
no engine makes the rig faster than that.

    python benchmarks/mechanism.py
"""

from __future__ import annotations

import ctypes
import statistics
import tempfile
import time
from pathlib import Path

import numpy as np
from compiled import compiled
from figures import at_least, at_most

from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, execute
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd_sim.mechanism import kernel, records
from rigd_sim.mechanism.plant import MechanismConfig, MechanismPlant

SOURCE = Path(__file__).with_name("mechanism_reference.c")
ROUNDS = 31
STEPS = 16_000  # a second of rig time
TARGET_RATIO = 1.5
TARGET_PACE = 100

#: Four bodies; belt, arm, press, contact, bearing, guide and two drives: eight elements.
EIGHT = """\
step: {step}
bodies:
  motor: {{inertia: 2e-3 kg m^2}}
  disk: {{inertia: 5e-3 kg m^2}}
  pin: {{mass: 0.5 kg}}
  loader: {{mass: 1 kg}}
springs:
  belt: {{between: [motor, disk], radius: [20 mm, 60 mm], stiffness: 50 kN/m, damping: 30 N s/m}}
  arm: {{between: [pin, ground], stiffness: 50 kN/m, damping: 20 N s/m}}
  press: {{between: [ground, loader], stiffness: 20 kN/m, damping: 60 N s/m, preload: -2 N}}
friction:
  contact:
    between: [disk, pin]
    radius: 30 mm
    pressed_by: press
    law: {{kind: lugre, coulomb: 0.12, static: 0.16, stribeck_speed: 20 mm/s, sigma_0: 10000 1/m,
           sigma_1: 5 s/m, viscous: 0.02 s/m}}
  bearings:
    between: [disk, ground]
    law: {{kind: coulomb, coulomb: 20 mN m, viscous: 0.5 mN m s/rad, smooth: 0.2 rad/s}}
  guide: {{between: [loader, ground], law: {{kind: viscous, viscous: 5 N s/m}}}}
drives:
  spindle: {{body: motor, mode: speed, limit: 4 N m, speed_limit: 100 rad/s, gain: 0.5 N m s/rad,
            integral: 5 N m/rad}}
  load: {{body: loader, mode: force, limit: 60 N}}
sensors:
  encoder: {{measures: position, of: disk, low: -1e6 rad, high: 1e6 rad, resolution: 1 mrad}}
  cell: {{measures: force, of: arm, low: -50 N, high: 50 N, noise: 20 mN, bandwidth: 1 kHz}}
  load_cell: {{measures: load, of: contact, low: 0 N, high: 100 N, noise: 50 mN, bandwidth: 1 kHz}}
"""
RIG = """\
rig: eight
title: eight elements
cycle: {cycle}
plant: {{model: mechanism, parameters: eight.yaml}}
devices:
  spindle:
    driver: sim-mechanism
    options: {{channels: {{angle: encoder}}, setpoints: {{speed: spindle}}}}
    limits: {{speed: {{low: 0 rad/s, high: 90 rad/s, rate: 200 rad/s^2}}}}
  loader:
    driver: sim-mechanism
    options: {{channels: {{load: load_cell}}, setpoints: {{force: load}}}}
    limits: {{force: {{low: 0 N, high: 50 N, rate: 100 N/s}}}}
  cell: {{driver: sim-mechanism, options: {{channels: {{force: cell}}}}}}
interlocks:
  - {{name: overload, source: cell.force, low: -40 N, high: 40 N, action: abort, priority: high,
     message: The load cell is overloaded.}}
"""
PROCEDURE = """\
procedure: turn
title: turn under load
doc: Turns the disk under load.
trial:
  steps:
    - {step: press, set: {loader.force: 20 N}, for: 1 s}
    - {step: turn, set: {spindle.speed: 60 rad/s}, for: 58 s}
    - {step: rest, set: {spindle.speed: 0 rad/s}, for: 1 s}
"""


def plant_of(folder: Path, step: str) -> MechanismPlant:
    path = folder / "eight.yaml"
    path.write_text(EIGHT.format(step=step), "utf-8")
    plant = MechanismPlant(MechanismConfig(parameters=str(path)), period_ns=1_000_000, seed=1)
    plant.command(0, 60.0, enabled=True)
    plant.command(1, 20.0, enabled=True)
    return plant


def kernels(folder: Path) -> None:
    """Compare a second of steps in both languages, and their states at its end."""
    layout = {
        "element": records.ELEMENT,
        "term": records.TERM,
        "sensor": records.SENSOR,
        "warm": records.WARM,
        "filter": records.FILTER,
        "tally": records.TALLY,
    }
    pointer, whole = ctypes.c_void_p, ctypes.c_long
    arguments = [pointer] * 5 + [ctypes.c_double] + [pointer] * 7 + [ctypes.c_double] + [whole] * 6
    reference = compiled(SOURCE, layout, arguments)
    ratios, times, worst = [], [], 0.0
    for _ in range(ROUNDS):
        ours, theirs = plant_of(folder, "62.5 us"), plant_of(folder, "62.5 us")
        h = ours._step_ns * 1e-9  # noqa: SLF001  # the step that the plant takes
        a, b = ours.memory, theirs.memory
        start = time.perf_counter_ns()
        kernel.integrate(
            a.masses, a.elements, a.sensors, a.warm, a.heat, a.ambient, a.commands, a.state,
            a.terms, a.again, a.work, a.filters, a.tally, h, STEPS,
        )  # fmt: skip
        middle = time.perf_counter_ns()
        arrays = [
            item.ctypes.data if hasattr(item, "ctypes") else item
            for item in (b.masses, b.elements, b.sensors, b.warm, b.heat, b.ambient, b.commands,
                         b.state, b.terms, b.again, b.work, b.filters, b.tally)
        ]  # fmt: skip
        sizes = (len(b.masses) - 1, len(b.elements), len(b.sensors), len(b.warm), b.work.shape[1])
        reference(*arrays, h, STEPS, *sizes)
        end = time.perf_counter_ns()
        ratios.append((middle - start) / (end - middle))
        times.append((middle - start) / STEPS)
        scale = np.maximum(np.abs(b.state), 1e-6)
        worst = max(worst, float((np.abs(a.state - b.state) / scale).max()))
    print(
        f"{min(times):.0f} ns a step of {h * 1e6:g} us, {h * 1e9 / min(times):.0f} x real time; "
        f"the states differ by {worst:.1e} after {STEPS} steps"
    )
    at_most("mechanism kernel / C -O3, eight elements", statistics.median(ratios), TARGET_RATIO)


def plant_alone(folder: Path, period_ns: int, step: str) -> None:
    """Print the least CPU time in which the plant takes a cycle, of thirty parts of a second."""
    plant, times = plant_of(folder, step), []
    cycles = 1_000_000_000 // period_ns
    for _ in range(30):
        cpu = time.process_time()
        for _ in range(cycles):
            plant.evolve(period_ns, period_ns)
        times.append((time.process_time() - cpu) / cycles)
    print(
        f"{period_ns * 1e-6:g} ms in steps of {step}: the plant alone {min(times) * 1e6:.1f} us a "
        f"cycle, {period_ns * 1e-9 / min(times):.0f} x"
    )


def end_to_end(folder: Path, cycle: str, step: str) -> None:
    """Run a minute of rig time from the first cycle to the closed file, three times."""
    (folder / "eight.yaml").write_text(EIGHT.format(step=step), "utf-8")
    (folder / "rig.yaml").write_text(RIG.format(cycle=cycle), "utf-8")
    (folder / "turn.yaml").write_text(PROCEDURE, "utf-8")
    paces = []
    for seed in range(1, 4):
        rig = load_rig(folder / "rig.yaml")
        source = load_procedure(folder / "turn.yaml")
        procedure = compile_procedure(source, rig, {})
        path = folder / f"{seed}.mcap"
        path.unlink(missing_ok=True)
        request = RunRequest(procedure, source.file.text, rig, seed, output=path)
        wall, cpu = time.perf_counter(), time.process_time()
        recorded = execute(request)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        paces.append((recorded.result.run_s / wall, recorded.result.run_s / cpu))
        print(
            f"{cycle}, steps of {step}: {paces[-1][0]:.0f} x in wall, {paces[-1][1]:.0f} x in CPU"
        )
    at_least(
        f"eight elements end to end at {cycle}, rig time / CPU time",
        statistics.median(pace for _, pace in paces), TARGET_PACE,
    )  # fmt: skip


def main() -> None:
    """Compare the kernels, then run the whole rig."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kernels(folder)
        for cycle, period_ns, step in (
            ("1 kHz", 1_000_000, "62.5 us"),
            ("1 kHz", 1_000_000, "250 us"),
            ("100 Hz", 10_000_000, "250 us"),
        ):
            plant_alone(folder, period_ns, step)
            end_to_end(folder, cycle, step)


if __name__ == "__main__":
    main()
