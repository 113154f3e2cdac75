"""The automatic stop of the approach-angle rig at the wire, run after run, as the bench sees it."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from support.wire import ANGLE, ROOT, WireRig, wire_rig

from rigd.config.loader import load_rig

#: Travel at which a run is to stop, in m, as in procedures/approach_angles.yaml.
STOP_M = 0.30
SETS = {
    "clean_0": (0, "clean"), "clean_15": (15, "clean"), "clean_30": (30, "clean"),
    "clean_45": (45, "clean"), "coated_0": (0, "coated"),
}  # fmt: skip
#: A crowded machine gives an answer within this time, in s.
PATIENCE_S = 120.0
LOOK_S = 0.05

PROCEDURE = """\
procedure: stops
title: Drives to the automatic stop, again and again
doc: The drive of approach_angles alone; a machine pushes the platform back.
parameters:
  voltage: {{doc: Of the motor, unit: V, min: 3 V, max: 10 V}}
  angle: {{doc: Of approach, unit: deg, min: 0 deg, max: 45 deg}}
  wheel: {{doc: Its surface, choices: [clean, coated]}}
  load: {{doc: Of the wheel, unit: kg, min: 4 kg, max: 8 kg}}
sweep:
  zip:
    voltage: [{voltage}]
    angle: [{angle}]
    wheel: [{wheel}]
    load: [{load}]
trial:
  steps:
    - {{prompt: voltage, text: Voltage?, unit: V, min: 3 V, max: 10 V, answer: "${{voltage}}",
        changes: voltage}}
    - {{prompt: angle, text: Angle?, unit: deg, min: 0 deg, max: 45 deg, answer: "${{angle}}",
        changes: angle}}
    - {{prompt: wheel, text: Wheel?, choices: ["${{wheel}}"], answer: "${{wheel}}", changes: wheel}}
    - {{prompt: load, text: Load?, unit: kg, min: 4 kg, max: 8 kg, answer: "${{load}}",
        changes: load}}
    - prompt: push_back
      text: Push it back.
      choices: [start]
      answer: start
      changes: platform
      until: "|daq.platform_position| < 40 mm and |daq.wheel_angle| < 2 rad for 50 ms"
      timeout: 10 s
    - {{step: ready, for: 50 ms}}
    - step: drive
      set: {{relay.closed: 1}}
      until: [daq.platform_position > 0.3 m, daq.wheel_angle > 50 rad]
      timeout: 1.5 s
      on_timeout: end_trial
    - {{step: stopped, set: {{relay.closed: 0}}, for: 60 ms}}
  after:
    - {{step: come to rest, set: {{relay.closed: 0}}, for: {rest} s}}
record: {{relay: 1, daq: {{every: 1, during: [ready, drive, stopped]}}}}
"""


@dataclass(frozen=True)
class Drive:
    """What is set up for one run."""

    set_name: str
    load_kg: float
    voltage_v: float


@dataclass(frozen=True)
class Stop:
    """One automatic stop, by the hidden state of the plant."""

    at_ns: int
    position_m: float  #: true, when the line opened the relay
    shown_m: float  #: what the potentiometer showed then, on the scale that the stop is judged by
    speed_m_s: float
    furthest_m: float  #: true, until the next run

    @property
    def overshoot_m(self) -> float:
        """How far the platform was beyond the threshold, as the sensor shows it."""
        return self.shown_m - STOP_M

    @property
    def overshoot_s(self) -> float:
        """The same as a time at the speed it had: m per m/s, ``ms*V`` in other words."""
        return self.overshoot_m / self.speed_m_s


@contextmanager
def angle_rig(
    folder: Path, name: str = "angle-wire-test", replaced: Mapping[str, str] | None = None
) -> Iterator[WireRig]:
    """The shipped approach-angle rig at the wire, in a folder of its own, served.

    It is the individual that the shipped calibration is of, under another name.
    """
    calibration = Path("calibrations") / "approach_angle.yaml"
    text = (ROOT / "configs" / calibration).read_text()
    assert ANGLE.name in text
    (folder / calibration.parent).mkdir(exist_ok=True)
    (folder / calibration).write_text(text.replace(ANGLE.name, name))
    with wire_rig(folder, name, replaced, ANGLE) as rig:
        yield rig


def write_procedure(path: Path, drives: Sequence[Drive], rest_s: float = 0.8) -> Path:
    """Write the procedure that does ``drives`` one after the other."""
    columns = {
        "voltage": [f"{drive.voltage_v:g} V" for drive in drives],
        "angle": [f"{SETS[drive.set_name][0]} deg" for drive in drives],
        "wheel": [SETS[drive.set_name][1] for drive in drives],
        "load": [f"{drive.load_kg:g} kg" for drive in drives],
    }
    joined = {name: ", ".join(values) for name, values in columns.items()}
    path.write_text(PROCEDURE.format(**joined, rest=rest_s))
    return path


def drive_to_stops(
    rig: WireRig, procedure: Path, recording: Path, state: Mapping[str, str]
) -> tuple[list[Stop], str]:
    """Run ``procedure`` in processes of its own; return its stops, and what the run printed."""
    log = recording.with_suffix(".log")
    with log.open("wb") as out:
        run = subprocess.Popen(
            [
                *(sys.executable, "-m", "rigd", "run", str(procedure), "--yes"),
                *("--rig", str(rig.rig), "--output", str(recording)),
            ],
            cwd=ROOT, env=dict(state), stdin=subprocess.DEVNULL, stdout=out, stderr=out,
            start_new_session=True,
        )  # fmt: skip
        try:
            stops = list(_watch(rig, run))
        finally:
            if run.poll() is None:
                run.kill()
            run.wait()
    return stops, log.read_text()


def _watch(rig: WireRig, run: subprocess.Popen[bytes]) -> Iterator[Stop]:
    """Yield every stop once the next run begins, or ``run`` has ended and all rests."""
    card: Any = load_rig(rig.rig).devices["daq"].config
    (pot,) = (item for item in card.inputs if item.name == "platform_position")

    def as_seen(relay: Mapping[str, Any]) -> Stop:
        shown = (relay["opened_volts"] - pot.zero) * pot.gain
        return Stop(
            relay["opened_ns"], relay["opened_position"], shown, relay["opened_speed"],
            relay["furthest_position"],
        )  # fmt: skip

    before = rig.parts()["relay"]["closings"]
    last: Stop | None = None
    quiet_until = time.monotonic() + PATIENCE_S
    while True:
        ended = run.poll() is not None
        state = rig.ask(do="state")
        relay = state["parts"]["relay"]
        if relay["closings"] > before:
            quiet_until = time.monotonic() + PATIENCE_S
            if relay["coil"]:
                if last is not None:
                    yield last
                    last = None
            else:
                last = as_seen(relay)
        if ended and (last is None or state["plant"]["resting"]):
            break
        if time.monotonic() > quiet_until:
            raise AssertionError(f"no run within {PATIENCE_S:g} s")
        time.sleep(LOOK_S)
    if last is not None:
        yield last
