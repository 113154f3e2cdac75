"""What 32 derived channels cost the cycle at the wire at 1 kHz: beside the same rig without them.

Both procedures run in turn on one served rig. The second computes 32 channels in eight groups. What
a cycle takes and how late it begins come from the recordings. The machine's load is printed: other
programs on it make both later.

    python benchmarks/derived_wire.py                     three rounds of 20 s each
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np
from derived import FOUR
from figures import at_most, noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.killing import SHAKING
from support.wire import wire_rig

from rigd.config.loader import load_rig
from rigd.config.rig import RigConfig
from rigd.daemon.execute import RunRequest, execute
from rigd.engine.control import Control
from rigd.engine.result import Progress
from rigd.model.severity import Severity
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.record import Recording

#: As in ``cycle.py``: the run is to go on although the host is away at times.
PATIENT = {
    "daemon_silence: 1 s": "daemon_silence: 10 s",
    "stale_after: 250 ms": "stale_after: 500 ms",
}
#: Of the run, before it is measured, in s.
SETTLING_S = 1.0


def texts() -> tuple[str, str]:
    """Return the procedure without and with derived channels."""
    derived = "".join(FOUR.format(g=f"s{n}", n=n) for n in range(8))
    return SHAKING.procedure, SHAKING.procedure.replace("trial:\n", f"derived:\n{derived}trial:\n")


def played(rig: RigConfig, text: str, seconds: float, recording: Path) -> tuple[float, float]:
    """Return the median time of a cycle and the 99.9th percentile of its lateness, in us.

    Raises:
        RuntimeError: the run ended by itself.
    """
    procedure = compile_procedure(parse_procedure(text, Path("shake.yaml")), rig, {})
    control = Control()
    timer = threading.Timer(SETTLING_S + seconds, control.request, (Severity.STOP, "measured"))

    def watch(progress: Progress) -> None:
        if progress.step == "shake" and timer.ident is None:
            timer.start()

    request = RunRequest(procedure, text, rig, 1, pace=1, output=recording)
    done = execute(request, watch=watch, control=control)
    if done.result.reason != "measured":
        timer.cancel()
        raise RuntimeError(f"the run ended by itself: {done.result.reason}")
    cycles = Recording.open(recording).trial(1)["cycle"]
    due = cycles["scheduled"]
    measured = due > due[0] + SETTLING_S
    late_us = 1e6 * (cycles["actual"] - due)[measured]
    spent_us = 1e6 * cycles["spent"][measured]
    return float(np.median(spent_us)), float(np.percentile(late_us, 99.9))


def main() -> None:
    """Play both in turn and report what the channels add."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    rounds = []
    with (
        tempfile.TemporaryDirectory() as folder,
        wire_rig(Path(folder), f"wire-derived-{os.getpid()}", PATIENT) as served,
    ):
        rig = load_rig(str(served.rig))
        for turn in range(args.rounds):
            pair = [
                played(rig, text, args.seconds, Path(folder) / f"{turn}{n}.mcap")
                for n, text in enumerate(texts())
            ]
            load = os.getloadavg()[0]
            (spent, late), (more, later) = pair
            print(f"round {turn + 1}, load {load:.1f}: a cycle takes {spent:.0f} us, with 32 "
                  f"channels {more:.0f} us; p99.9 late {late:.0f} us, {later:.0f} us",
                  flush=True)  # fmt: skip
            rounds.append((more - spent, 100 * (later / late - 1), load))
    added, later, load = (statistics.median(column) for column in zip(*rounds, strict=True))
    noted("load of the machine meanwhile", load, "processes")
    at_most("32 derived channels at the wire, added to a cycle", added, 40, "us")
    at_most("32 derived channels at the wire, p99.9 lateness more by", later, 10, "%")


if __name__ == "__main__":
    main()
