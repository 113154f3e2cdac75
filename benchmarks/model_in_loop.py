"""What a model in the loop costs the cycle at the wire at 1 kHz, and how soon its answer is there.

The same rig runs in turn without and with an FMU between the current of its wheel and a channel.
What a cycle takes comes from the recordings, and so does what the FMU took. Then the round trip
alone: from the request to the answer at the socket, with the FMU's process at real-time priority,
once a millisecond. The machine's load is printed: other programs on it make all of it later.

    python benchmarks/model_in_loop.py                    three rounds of 20 s each
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from computing_wire import PATIENT, SETTLING_S, played
from figures import noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.faults.killing import SHAKING
from support.fmu import build
from support.wire import wire_rig

from rigd.config.loader import parse_rig
from rigd.record import Recording
from rigd_sim.fmu.loop_device import FmuInLoop, FmuInLoopConfig

MS = 1_000_000
DEVICE = """\
  vehicle:
    driver: fmu-in-loop
    options:
      file: FILE
      late: 500
      inputs: {free: {channel: wheel_servo.current, unit: A}}
      outputs: {speed: omega, steps: steps}

interlocks:
"""


def round_trips(fmu: Path, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return round trips and the time that the FMU took in them, in us, shape (count,) each."""
    config = FmuInLoopConfig.model_validate(
        {"file": str(fmu), "inputs": {"torque": "x.torque"}, "outputs": {"speed": "omega"},
         "late": 10_000},
        context={"period_ns": MS},
    )  # fmt: skip
    model = FmuInLoop(config)
    model.open()
    found, took = [], []
    try:
        for cycle in range(count + 100):
            begun = time.perf_counter_ns()
            model.take_inputs(cycle * MS, [0.01], late=False)
            while (row := model.read((cycle + 1) * MS)) is None:
                pass
            found.append(time.perf_counter_ns() - begun)
            took.append(row[1])
            time.sleep(1e-3)
    finally:
        model.close()
    return 1e-3 * np.array(found[100:]), 1e6 * np.array(took[100:])


def main() -> None:
    """Play both rigs in turn and report what the model adds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    rounds = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fmu = build(folder)
        with wire_rig(folder, f"wire-loop-{os.getpid()}", PATIENT) as served:
            text = served.rig.read_text()
            device = DEVICE.replace("FILE", str(fmu))
            texts = text, text.replace("interlocks:\n", device, 1)
            rigs = [parse_rig(item, served.rig) for item in texts]
            for turn in range(args.rounds):
                files = [folder / f"{turn}{n}.mcap" for n in range(2)]
                pair = [
                    played(rig, SHAKING.procedure, args.seconds, file)
                    for rig, file in zip(rigs, files, strict=True)
                ]
                load = os.getloadavg()[0]
                rows = Recording.open(files[1]).trial(1)["vehicle"]
                measured = np.asarray(rows["trial_time"]) > SETTLING_S
                late = 100 * float(np.mean(np.asarray(rows["late"])[measured] > 0))
                spent = 1e6 * float(np.median(np.asarray(rows["spent"])[measured]))
                (without, begun), (within, later) = pair
                print(f"round {turn + 1}, load {load:.1f}: a cycle takes {without:.0f} us, with the"
                      f" model {within:.0f} us; p99.9 late {begun:.0f} us, {later:.0f} us;"
                      f" the FMU takes {spent:.0f} us, {late:.2f} % of rows late",
                      flush=True)  # fmt: skip
                rounds.append((within - without, within / without, late, spent, load))
        trips, took = round_trips(fmu, 5000)
    added, ratio, late, spent, load = (
        statistics.median(column) for column in zip(*rounds, strict=True)
    )
    noted("load of the machine meanwhile", load, "processes")
    noted("a model in the loop at the wire, added to a cycle", added, "us")
    noted("the same, times the cycle without it", ratio, "")
    noted("rows of the model that came late", late, "%")
    noted("a step of the FMU, in its process", spent, "us")
    for share in (50, 99, 99.9):
        noted(f"round trip to the FMU, p{share:g}", float(np.percentile(trips, share)), "us")
    noted("round trip without the step, p50", float(np.median(trips - took)), "us")


if __name__ == "__main__":
    main()
