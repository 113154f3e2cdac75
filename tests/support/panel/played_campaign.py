"""What the played rig plays: ten currents on one floor, and what it has to show."""

from __future__ import annotations

import base64
import hashlib
import math
import random
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigd.remote.protocol.arguments import ComparedRuns, PieceArguments, ProcedureFile
from rigd.remote.protocol.frame import Frame, encode_frame
from rigd.remote.protocol.results import (
    ActionView,
    ChannelView,
    CheckReport,
    DryRun,
    InterlockView,
    ParameterView,
    PeakView,
    PieceView,
    ProblemView,
    ProcedureLine,
    Procedures,
    ProcedureView,
    RenewedCalibration,
    RenewedValue,
    RunLine,
    SetpointView,
    StepView,
    StreamView,
)
from rigd.remote.protocol.status import PromptView, TripView

STEP_S = 1e-3
PROCEDURE_FILES = Path(__file__).parents[3] / "procedures"


def _channel(name: str, unit: str, doc: str, bound: float = math.inf) -> ChannelView:
    limit = None if math.isinf(bound) else bound
    return ChannelView(
        name=name, unit=unit, doc=doc, low=None if limit is None else -limit, high=limit
    )


STREAMS = {
    stream.name: stream
    for stream in (
        StreamView(number=0, name="wheel_servo", rate_hz=1000, channels=(
            _channel("current_setpoint", "A", "Commanded motor current", 2.0),
            _channel("current", "A", "Motor current", 2.0),
        )),
        StreamView(number=1, name="wheel_encoder", rate_hz=1000, channels=(
            _channel("angle", "rad", "Angle of the wheel"),
            _channel("speed", "rad/s", "Speed of the wheel"),
        )),
        StreamView(number=2, name="carriage", rate_hz=1000, channels=(
            _channel("position", "m", "Position of the carriage on its guide"),
            _channel("speed", "m/s", "Speed of the carriage"),
        )),
        StreamView(number=3, name="accelerometer", rate_hz=1000, channels=(
            _channel("acceleration", "m/s^2", "Acceleration of the carriage", 50.0),
        )),
        StreamView(number=4, name="longitudinal_belt", rate_hz=1000, channels=(
            _channel("speed", "m/s", "Speed of the belt"),
            _channel("engaged", "1", "Whether the clutch holds the carriage", 1.0),
        )),
    )
}  # fmt: skip
CHANNELS = {name: [channel.name for channel in stream.channels] for name, stream in STREAMS.items()}
SETPOINTS = (
    SetpointView(name="wheel_servo.current", unit="A", low=-1.6, high=1.6, rate=2000.0),
    SetpointView(name="longitudinal_belt.speed", unit="m/s", low=-0.5, high=0.5, rate=5.0),
    SetpointView(name="longitudinal_belt.engaged", unit="1", low=0.0, high=1.0, rest=1.0),
)
INTERLOCKS = (
    InterlockView(name="overrun_far", source="carriage.position", high=1.65, action="abort",
                  priority="critical", latch=True,
                  message="The carriage is about to leave the far end of the travel."),
    InterlockView(name="overrun_near", source="carriage.position", low=-0.04, action="abort",
                  priority="critical", latch=True,
                  message="The carriage is about to leave the near end of the travel."),
    InterlockView(name="over_current", source="wheel_servo.current", low=-1.8, high=1.8,
                  action="abort", priority="high", latch=False,
                  message="The wheel motor draws more current than was commanded."),
    InterlockView(name="wheel_encoder_silent", source="wheel_encoder.angle", action="abort",
                  priority="high", latch=False, message="The wheel encoder gives no values."),
)  # fmt: skip


ACTIONS = (ActionView(device="scale", action="tare", doc="Zero the reading"),)


def _procedure(name: str, title: str, *parameters: ParameterView) -> ProcedureView:
    text = (PROCEDURE_FILES / f"{name}.yaml").read_text()
    file = ProcedureFile.of(name, text)
    doc = (
        "The motor gets one constant current per trial, from 0.15 A to 1.5 A in steps of 0.15 A, "
        "until the carriage has gone far enough to be stopped safely; then it is brought back and "
        "the next current follows."
    )
    return ProcedureView(
        procedure=file, title=title, doc=doc, parameters=parameters, on_client_loss="stop"
    )


PROCEDURES = {
    item.procedure.name: item
    for item in (
        _procedure(
            "constant_current", "Identification tests with constant currents on one floor",
            ParameterView(name="floor", doc="Floor under the wheel", default="stone",
                          choices=("stone", "pvc", "paperboard")),
            ParameterView(name="current", doc="Motor current of the trial", unit="A", min="0 A",
                          max="1.5 A", swept=True),
            ParameterView(name="brake_at", unit="m", default="1.15 m", min="0.3 m", max="1.25 m",
                          doc="Where the drive ends; at full speed the carriage needs 0.1 m"),
            ParameterView(name="longest_drive", doc="When a trial ends that does not get there",
                          unit="s", default="4 s", min="1 s", max="30 s"),
        ),
        _procedure("quick", "A first run: one current, a few seconds"),
        _procedure("lateral_sweep", "Lateral sweep of the bridge at five speeds"),
    )
}  # fmt: skip

#: What the daemon lists: the last one does not fit its rig.
LISTED = Procedures(
    procedures=(
        *(
            ProcedureLine(name=name, title=item.title, sha256=item.procedure.sha256)
            for name, item in PROCEDURES.items()
        ),
        ProcedureLine(
            name="calibrate_scale", title="Calibrate the scale", sha256="0" * 64,
            problem="the rig lugre-1 has no channel 'scale.mass'",
        ),
    )
)  # fmt: skip
#: A procedure as it travels, and the text of its file.
FILE = PROCEDURES["quick"].procedure
TEXT = FILE.text

PROMPT = PromptView(
    id=7, name="lay_floor", kind="choice", choices=("stone",), answer="stone",
    text="Lay the stone floor under the wheel. Which floor lies there now?",
)  # fmt: skip
WEIGH = PromptView(
    id=8, name="weigh", kind="number", unit="g", low=1.0, high=6.0,
    text="Weigh the carriage with its load. What does the scale show?",
)  # fmt: skip
TRIP = TripView(
    interlock="overrun_far", action="abort", latched=True, acknowledged=False, since_ns=1,
    message="carriage.position 1.68 m is above 1.65 m. The carriage is about to leave the far end "
    "of the travel.",
)  # fmt: skip
#: What `rigd info --json` returns for a recording, as far as the page reads it.
DETAILS: dict[str, Any] = {
    "seed": "1",
    "parameters": {"floor": "stone", "brake_at": "1.15 m", "longest_drive": "4 s"},
    "trials": [
        {"number": number, "parameters": {"current": 0.15 * number}, "units": {"current": "A"}}
        for number in range(1, 5)
    ],
}
RECORDING = bytes(range(256)) * 3000  # three pieces

COMPARISON = b"""<!doctype html><title>Comparison</title><h1>Comparison of campaigns</h1></html>"""
RUN_PAGE = b"""<!doctype html><html lang="en"><title>Run</title><h1>What was recorded</h1></html>"""
REPORT = b"""<!doctype html><html lang="en"><title>Report</title>
<style>body{font:16px/1.5 system-ui;margin:2rem;max-width:60rem}td,th{padding:.3rem 1rem}</style>
<h1>LuGre model of constant_current</h1><p>Ten trials on stone.</p>
<table><tr><th>Parameter<th>Value<th>95 %<tr><td>mu_c<td>0.1203<td>&plusmn; 0.0007</table>
<script>document.title = "a script ran"</script></html>"""


def run_line(run: str, state: str = "complete", **more: Any) -> RunLine:
    """Return what a list of recordings shows of ``run``."""
    trials = 10 if state == "complete" else 4
    known = {
        "procedure": "constant_current", "started_ns": time.time_ns(), "duration_s": 93.4,
        "trials_done": trials, "trials_total": 10, "size": len(RECORDING), "has_report": False,
        "has_page": False, "identifies": True, "set": "floor=pvc, current=0.9 A", "specimen": "W7",
    }  # fmt: skip
    return RunLine.model_validate({"run": run, "state": state, **known, **more})


def past_runs() -> list[RunLine]:
    """Return the recordings, the newest first: the first has no report, the third none to make."""
    return [
        run_line(
            f"2026-11-{day:02d}T09-12-0{day % 10}_constant_current.mcap",
            "complete" if day % 3 else "stopped",
            started_ns=time.time_ns() - (40 - day) * 86_400 * 10**9,
            has_report=bool(day % 2), has_page=day == 19, identifies=day != 18,
            calibrates=day in (20, 18),
        )
        for day in range(20, 12, -1)
    ]  # fmt: skip


def renewed_by(operator: str, *, write: bool) -> RenewedCalibration:
    """Return what a calibration of the scale gives."""
    return RenewedCalibration(
        file="bench.yaml",
        values=(
            RenewedValue(
                name="load_scale", unit="1", new="0.99862 ± 0.00070", old="0.99901 ± 0.00070",
                deviation=-0.39,
            ),
        ),
        operator=operator,
        valid_until="2027-11-21",
        remarks=("load_scale: the new value was measured before the value that it replaces.",),
        written=write,
    )  # fmt: skip


def piece(whole: bytes, wanted: PieceArguments | ComparedRuns) -> PieceView:
    """Return the piece of a file that was asked for."""
    data = base64.b64encode(whole[wanted.offset : wanted.offset + wanted.length])
    sha256 = hashlib.sha256(whole).hexdigest()
    return PieceView(size=len(whole), sha256=sha256, offset=wanted.offset, data=data)


def past(stream: str) -> bytes:
    """Return ten seconds in which nothing moved, until now, in base64."""
    t_s = np.arange(0.0, 10.0, 0.1)
    values = np.zeros((len(CHANNELS[stream]), t_s.size), "f4")
    began_ns = time.time_ns() - 10 * 10**9
    frame = Frame(STREAMS[stream].number, 0, began_ns, t_s, values, values)
    return base64.b64encode(encode_frame(frame))


STEPS = (
    StepView(block="prepare", name="home", played=1, shortest_s=0.0, longest_s=0.0,
             setpoints=("wheel_servo.current = 0 A", "longitudinal_belt.speed = -0.2 m/s"),
             ends=("carriage.position < 0.002 m", "at most 20 s")),
    StepView(block="trial", name="settle", played=10, shortest_s=0.3, longest_s=0.3,
             setpoints=("wheel_servo.current = 0 A",), ends=("after 0.3 s",)),
    StepView(block="trial", name="drive", played=10, shortest_s=0.96, longest_s=4.0,
             setpoints=("wheel_servo.current = 0.15 .. 1.5 A",),
             ends=("carriage.position > 1.15 m", "at most 4 s")),
    StepView(block="after", name="brake", played=10, shortest_s=0.2, longest_s=0.44,
             setpoints=("wheel_servo.current = 0 A", "longitudinal_belt.speed = 0 m/s"),
             ends=("|longitudinal_belt.speed| < 0.005 m/s for 0.2 s", "at most 5 s")),
    StepView(block="after", name="return", played=10, shortest_s=0.0, longest_s=3.02,
             setpoints=("longitudinal_belt.speed = -0.4 m/s",),
             ends=("carriage.position < 0.03 m", "at most 20 s")),
    StepView(block="finish", name="hold", played=1, shortest_s=0.2, longest_s=0.2,
             setpoints=("longitudinal_belt.speed = 0 m/s",), ends=("after 0.2 s",)),
)  # fmt: skip


def check(settings: Mapping[str, str]) -> CheckReport:
    """Return whether it could run."""
    brake_at = settings.get("brake_at", "")
    if brake_at and float(brake_at.split()[0]) > 1.25:
        problem = ProblemView(
            message=f"--set brake_at={brake_at}: brake_at {brake_at} is above its max 1.25 m"
        )
        return CheckReport(ok=False, problems=(problem,))
    return CheckReport(ok=True, trials=10, prompts=1)


def dry_run(settings: Mapping[str, str]) -> DryRun:
    """Return what a dry run would find: braking late goes too far."""
    far = float(settings.get("brake_at", "1.15 m").split()[0]) + 0.12
    inside = far < 1.3
    peaks = (
        PeakView(channel="wheel_servo.current", unit="A", lowest=-0.31, highest=1.5, low=-1.6,
                 high=1.6, limit_by="rig file", inside=True),
        PeakView(channel="carriage.position", unit="m", lowest=-0.001, highest=far, low=-0.02,
                 high=1.3, limit_by="trial", inside=inside),
        PeakView(channel="longitudinal_belt.speed", unit="m/s", lowest=-0.4, highest=0.0,
                 low=-0.5, high=0.5, limit_by="rig file", inside=True),
    )  # fmt: skip
    refusals = () if inside else ("trial 10 would end early: carriage.position above 1.3 m",)
    return DryRun(
        ok=inside, duration_s=93.4, trials=10, steps=STEPS, peaks=peaks, refusals=refusals
    )


class Carriage:
    """Drives, brakes and comes back, ten times: Coulomb friction, a belt, and some noise."""

    MASS_KG = 3.96
    FRICTION_N = 4.9
    FORCE_N_PER_A = 6.2

    def __init__(self) -> None:
        self.trial = 1
        self.step = "settle"
        self.values = {f"{s}.{name}": 0.0 for s in STREAMS for name in CHANNELS[s]}
        self.values["longitudinal_belt.engaged"] = 1.0
        self._in_step_s = 0.0
        self._noise = random.Random(1)

    @property
    def target(self) -> float:
        """The current of the trial in A."""
        return 0.45 + 0.1 * self.trial

    def play(
        self, dt_s: float, runs: bool
    ) -> tuple[NDArray[np.float64], dict[str, NDArray[np.float64]], bool]:
        """Return the times in s, the values by channel, and whether a trial ended."""
        count = round(dt_s / STEP_S)
        rows = {name: np.empty(count) for name in self.values}
        ended = False
        for index in range(count):
            if runs:
                ended = self._advance() or ended
            else:
                self._drive(0.0, -20.0 * self.values["carriage.speed"])
            for name, value in self.values.items():
                rows[name][index] = value
        return np.arange(count, dtype=np.float64) * STEP_S, rows, ended

    def _advance(self) -> bool:
        self._in_step_s += STEP_S
        here = self.values["carriage.position"]
        match self.step:
            case "settle":
                self._belt(0.0, 1.0)
                self._drive(0.0, 0.0)
                if self._in_step_s > 0.8:
                    self._next("drive")
            case "drive":
                self._belt(0.0, 0.0)
                self._drive(self.target, 0.0)
                if here > 1.15 or self._in_step_s > 4.0:
                    self._next("brake")
            case "brake":
                self._belt(0.0, 1.0)
                self._drive(0.0, -60.0 * self.values["carriage.speed"])
                if self._in_step_s > 0.6:
                    self._next("return")
            case _:
                wanted = -0.4 if here > 0.05 else -0.05
                self._belt(wanted, 1.0)
                self._drive(0.0, 200.0 * (wanted - self.values["carriage.speed"]))
                if here < 0.002:
                    self._next("settle")
                    self.trial = self.trial % 10 + 1
                    return True
        return False

    def _next(self, step: str) -> None:
        self.step, self._in_step_s = step, 0.0

    def _belt(self, speed: float, engaged: float) -> None:
        self.values["longitudinal_belt.speed"] = speed
        self.values["longitudinal_belt.engaged"] = engaged

    def _drive(self, current: float, force_n: float) -> None:
        values = self.values
        values["wheel_servo.current_setpoint"] = current
        drawn = values["wheel_servo.current"]
        drawn += (current - drawn) * 0.02
        values["wheel_servo.current"] = drawn + self._noise.gauss(0, 0.002)
        speed = values["carriage.speed"]
        friction = self.FRICTION_N * math.tanh(speed / 0.01) if not force_n else 0.0
        push = self.FORCE_N_PER_A * drawn * (2.2 - 0.5 * speed)
        acceleration = (push - friction + force_n) / self.MASS_KG
        if not force_n and abs(speed) < 1e-3 and push < self.FRICTION_N:
            acceleration, speed = 0.0, 0.0
        speed += acceleration * STEP_S
        values["carriage.speed"] = speed
        values["carriage.position"] += speed * STEP_S
        values["wheel_encoder.speed"] = speed / 0.05 * 1.03
        values["wheel_encoder.angle"] += values["wheel_encoder.speed"] * STEP_S
        values["accelerometer.acceleration"] = acceleration + self._noise.gauss(0, 0.05)
