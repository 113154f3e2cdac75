"""Compare FMUs of others, stepped by rigd, with the same FMUs simulated by FMPy in its own process.

    python benchmarks/foreign_fmus.py FOLDER

steps each FMU in FOLDER for 2 s by 1 ms with its own start values, and prints the largest
difference of its scalar outputs from ``fmpy.simulate_fmu``, and the time of a step in microseconds
of the wall. The wheels of gemseo-fmu (OpenModelica) and of modestpy (JModelica) have FMUs.
"""

import sys
import time
from pathlib import Path

import fmpy
import numpy as np
from pydantic import ValidationError

from rigd_sim.fmu.description import NUMBERS, read_fmu
from rigd_sim.fmu.plant import FmuConfig, FmuPlant

STEP_NS = 1_000_000
STEPS = 2000


def compare(path: Path) -> str:
    fmu = read_fmu(path)
    plant = FmuPlant(FmuConfig.model_validate({"file": str(path)}), period_ns=STEP_NS, seed=1)
    scalar = [item for item in fmu.variables.values() if item.kind in NUMBERS and not item.array]
    outputs = [item.name for item in scalar if item.causality == "output"]
    for name in outputs:
        plant.add_output(name)
    rows = [list(plant.outputs_at(0))]
    begun = time.perf_counter()
    rows += [list(plant.outputs_at(step * STEP_NS)) for step in range(1, STEPS + 1)]
    ours_us = 1e6 * (time.perf_counter() - begun) / STEPS
    plant.close()
    begun = time.perf_counter()
    result = fmpy.simulate_fmu(
        str(path), validate=False, fmi_type="CoSimulation", output=outputs,
        start_time=0.0, stop_time=STEPS * STEP_NS * 1e-9,
        step_size=STEP_NS * 1e-9, output_interval=STEP_NS * 1e-9,
    )  # fmt: skip
    theirs_us = 1e6 * (time.perf_counter() - begun) / STEPS
    theirs = np.array([result[name] for name in outputs], dtype=float).T
    ours = np.array(rows)
    assert theirs.shape == ours.shape, f"{theirs.shape} rows of FMPy, {ours.shape} of rigd"
    return (
        f"{path.name}: FMI {fmu.version}, {fmu.tool}: {len(outputs)} outputs differ by at most "
        f"{np.abs(ours - theirs).max():.3g}; a step {ours_us:.0f} us, of FMPy with its set-up "
        f"{theirs_us:.0f} us"
    )


def main() -> None:
    for path in sorted(Path(sys.argv[1]).resolve().glob("*.fmu")):
        try:
            print(compare(path), flush=True)
        except ValidationError as error:
            (detail,) = error.errors()
            print(f"{path.name}: {detail['msg']}", flush=True)


if __name__ == "__main__":
    main()
