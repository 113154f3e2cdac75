"""What a cycle at the wire at 1 kHz takes that computes: beside the same rig that does not.

Three procedures run in turn on one served rig. The second computes 32 derived channels in eight
groups. The third computes them too, with four controllers that act, one of them in a cascade, and
the filter of slip with its readings from real frames. What a cycle takes and how late it begins
come from the recordings. The machine's load is printed: other programs on it make both later.

    python benchmarks/computing_wire.py                   three rounds of 20 s each
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
from support.faults.killing import SHAKING
from support.lugre.slip import observer
from support.wire import wire_rig

from rigd.config.loader import parse_rig
from rigd.config.rig import RigConfig
from rigd.daemon.execute import RunRequest, execute
from rigd.engine.play.control import Control
from rigd.engine.run.result import Progress
from rigd.model.severity import Severity
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.record import Recording

#: As in ``cycle.py``: the run is to go on although the host is away at times.
PATIENT = {
    "daemon_silence: 1 s": "daemon_silence: 10 s",
    "stale_after: 250 ms": "stale_after: 500 ms",
}
LIMITS = "low: -0.5 m/s, high: 0.5 m/s, rate: 1 m/s^2"
HELD = "stale_after: 250 ms, stuck_after: 60 s"
#: Three that command devices, one that commands the first; and the filter.
ALL = f"""\
derived:
  rim.speed: {{is: derivative(wheel_encoder.angle) * rig.wheel_radius, lowpass: 30 Hz}}
controllers:
  rim_hold: {{measured: rim.speed, output: wheel_servo.current, kp: 15 A s/m, ki: 1000 A/m,
    limits: {{{LIMITS}}}, {HELD}}}
  side_hold: {{measured: lateral_belt.speed, output: lateral_belt.speed, ki: 1 1/s,
    limits: {{{LIMITS}}}, {HELD}}}
  belt_hold: {{measured: longitudinal_belt.speed, output: longitudinal_belt.speed, ki: 1 1/s,
    limits: {{{LIMITS}}}, {HELD}}}
  turn_hold: {{measured: wheel_encoder.angle, output: rim_hold, kp: 0.1 m/rad/s,
    output_limits: [-0.3 m/s, 0.3 m/s], limits: {{low: -9 rad, high: 9 rad}}, {HELD}}}
{observer()}"""
ACTING = """\
        turn_hold: {sine: {amplitude: 1 rad, frequency: 0.25 Hz}}
        side_hold: {sine: {amplitude: 10 mm/s, frequency: 0.5 Hz}}
        belt_hold: 0 m/s
"""

#: Of the run, before it is measured, in s.
SETTLING_S = 1.0


def texts() -> tuple[str, str, str]:
    """Return the procedure without and with derived channels, and with controllers too."""
    derived = "".join(FOUR.format(g=f"s{n}", n=n) for n in range(8))
    many = SHAKING.procedure.replace("trial:\n", f"derived:\n{derived}trial:\n")
    set_ = next(line for line in many.splitlines() if line.strip().startswith("set:"))
    return SHAKING.procedure, many, many.replace(set_, f"      set:\n{ACTING.rstrip()}")


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
    """Play all in turn and report what is added."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    rounds = []
    with (
        tempfile.TemporaryDirectory() as folder,
        wire_rig(Path(folder), f"wire-computing-{os.getpid()}", PATIENT) as served,
    ):
        text = served.rig.read_text()
        bare = parse_rig(text, served.rig)
        full = parse_rig(text.replace("interlocks:\n", f"{ALL}\ninterlocks:\n", 1), served.rig)
        for turn in range(args.rounds):
            (spent, late), (more, later), (most, latest) = (
                played(rig, procedure, args.seconds, Path(folder) / f"{turn}{n}.mcap")
                for n, (rig, procedure) in enumerate(zip((bare, bare, full), texts(), strict=True))
            )
            load = os.getloadavg()[0]
            print(f"round {turn + 1}, load {load:.1f}: a cycle takes {spent:.0f} us, with 32 "
                  f"channels {more:.0f} us, with all {most:.0f} us; p99.9 late {late:.0f} us, "
                  f"{later:.0f} us, {latest:.0f} us", flush=True)  # fmt: skip
            rounds.append(
                (more - spent, 100 * (later / late - 1), most - spent, 100 * (latest / late - 1),
                 load)
            )  # fmt: skip
    added, later, most, latest, load = (
        statistics.median(item) for item in zip(*rounds, strict=True)
    )
    noted("load of the machine meanwhile", load, "processes")
    at_most("32 derived channels at the wire, added to a cycle", added, 40, "us")
    at_most("32 derived channels at the wire, p99.9 lateness more by", later, 10, "%")
    whole = "32 channels, 4 controllers and the filter at the wire"
    at_most(f"{whole}, added to a cycle", most, 40, "us")
    at_most(f"{whole}, p99.9 lateness more by", latest, 10, "%")


if __name__ == "__main__":
    main()
