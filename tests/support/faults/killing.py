"""A run on the rig at the wire, killed in one of many ways, and what became of rig and samples."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from support.commands.command import rigd
from support.faults.stalls import witnessed
from support.recordings.blocks import alive
from support.wire import ROOT, WireRig

from rigd.config.loader import load_rig
from rigd.engine.cycle.rows import HeldRows
from rigd.engine.shared import RecorderState, RunFolder, Word, state_folder
from rigd.model.errors import Exit
from rigd.record import Recording

#: Processes that can be hit, and signals.
VICTIMS = ("daemon", "cycle", "recorder", "all")
SIGNALS = (signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
#: A crowded machine arms the rig within this time.
START_S = 90.0
#: After any event a run has ended this long after.
END_S = 60.0

#: Longer than this machine stalls at most times, and soon enough for a test that waits for it.
PATIENT = {"stale_after: 250 ms": "stale_after: 150 ms"}
#: The same at a quarter of the rate, which takes half of the CPU time.
QUARTER = PATIENT | {"cycle: 1 kHz": "cycle: 250 Hz"}


@dataclass(frozen=True)
class Movement:
    """What a rig is to be killed at, and how the simulation shows that nothing drives any more."""

    procedure: str
    drives: tuple[str, ...]  #: parts whose ``safe_since_ns`` is not 0 once they are safe
    moves: Callable[[Mapping[str, Any]], bool]  #: by the state of all parts
    stream: str  #: has a row in every cycle
    watchdog_s: float  #: longest of the drives


def _is_driven(servo: Mapping[str, Any]) -> bool:
    """Return whether a CAN servo gives its motor anything: A, or m/s."""
    given = servo.get("current", 0.0) or servo.get("speed", 0.0)
    return bool(servo["enabled"]) and abs(given) > 0.01


_SERVOS = ("wheel_servo", "longitudinal_belt", "lateral_belt")
SHAKING = Movement(
    """\
procedure: shake
title: Moves for as long as it is left alone
doc: The wheel turns to and fro while the belt holds the carriage.
trial:
  steps:
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: 0.3 A, frequency: 2 Hz}}}
      for: 7200 s
record: all
""",
    drives=_SERVOS,
    moves=lambda parts: any(_is_driven(parts[name]) for name in _SERVOS),
    stream="wheel_servo",
    watchdog_s=0.1,
)
#: How long before its condition, and after it, the belt of `CAPTURING` is recorded.
BEFORE_S, AFTER_S = 0.1, 0.03
PERIOD_S = 0.004  #: of a cycle of `QUARTER`
#: The process of the cycle holds rows of the belt for as long.
HELD_S = BEFORE_S + (HeldRows.CYCLES + 1) * PERIOD_S
#: The same, of which the belt is recorded around the largest currents alone.
CAPTURING = replace(
    SHAKING,
    procedure=SHAKING.procedure.replace(
        "record: all",
        f"""\
record:
  cycle: 1
  wheel_servo: 1
  longitudinal_belt:
    {{when: wheel_servo.current > 0.25 A, before: {BEFORE_S} s, after: {AFTER_S} s}}
""",
    ),
)
#: A rig file's controller of the speed of the rim of the wheel.
RIM_HOLD = {
    "interlocks:\n": """\
derived:
  rim.speed: {is: derivative(wheel_encoder.angle) * rig.wheel_radius, lowpass: 30 Hz}

controllers:
  rim_hold:
    measured: rim.speed
    output: wheel_servo.current
    kp: 15 A s/m
    ki: 1000 A/m
    limits: {low: -0.5 m/s, high: 0.5 m/s, rate: 1 m/s^2}
    stale_after: 150 ms

interlocks:
"""
}
HOLDING = replace(
    SHAKING,
    procedure="""\
procedure: hold
title: Holds for as long as it is left alone
doc: A controller lets the rim of the wheel go to and fro while the belt holds the carriage.
trial:
  steps:
    - step: hold
      set: {rim_hold: {sine: {amplitude: 0.1 m/s, frequency: 0.5 Hz}}}
      for: 7200 s
record: all
""",
)
#: The same, in a step that is held: the controller then lets the wheel turn at one speed.
HELD = replace(
    HOLDING,
    procedure=HOLDING.procedure.replace(
        "      for: 7200 s\n",
        "      for: 7200 s\n      hold: {set: {rim_hold: 0.08 m/s}, timeout: 1 h}\n",
    ),
)
DRIVING = Movement(
    """\
procedure: drive
title: Drives for as long as it is left alone
doc: The platform runs against its bumper, and the wheel slides on.
trial:
  steps:
    - step: drive
      set: {relay.closed: 1}
      for: 7200 s
record: {relay: 1, daq: 1}
""",
    drives=("relay",),
    moves=lambda parts: bool(parts["relay"]["contact"]),
    stream="relay",
    watchdog_s=0.2,
)


def heed_ctrl_c() -> None:
    """Let runs that this process starts heed SIGINT, also if a script runs it in the background.

    There it is ignored, and rigd inherits and respects that.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@dataclass(frozen=True)
class Killed:
    """What one kill led to. Times are CLOCK_MONOTONIC, in ns."""

    at_ns: int
    safe_after_s: float  #: until every drive was without torque
    noticed_after_s: float | None  #: until the cycle noticed the end of the daemon, if it did
    last_row_s: float  #: of the last sample in the file, relative to the kill
    gaps: int  #: cycles that ran and are not in the file
    exit_code: int | None
    ending: str  #: its end by the recording
    told: str  #: what the operator read


class Victim:
    """A run under way: started, moving, and every process of it known."""

    def __init__(
        self, rig: WireRig, folder: Path, state: Path, movement: Movement = SHAKING
    ) -> None:
        self.rig = rig
        self._movement = movement
        self.recording = folder / "run.mcap"
        self._state = state
        self._offset_ns = 0
        procedure = folder / "procedure.yaml"
        procedure.write_text(movement.procedure)
        self._log = (folder / "run.log").open("w+b")
        self.process = subprocess.Popen(
            [
                *(sys.executable, "-m", "rigd", "run", str(procedure), "--yes"),
                *("--rig", str(rig.rig), "--output", str(self.recording)),
            ],
            cwd=ROOT,
            env={**os.environ, "RIGD_STATE": str(state)},
            stdin=subprocess.DEVNULL,
            stdout=self._log,
            stderr=self._log,
            start_new_session=True,
        )
        self._wait_until_moving()

    def _wait_until_moving(self) -> None:
        deadline = time.monotonic() + START_S
        while self.process.poll() is None and time.monotonic() < deadline:
            if self._movement.moves(self.rig.parts()):
                return
            time.sleep(0.05)
        told = self.told()
        self.end()
        raise AssertionError(f"the run did not begin to move: {told}")

    def hold(self) -> None:
        """Hold the step that plays, as its operator would; return when it is held and moves."""
        deadline = time.monotonic() + START_S
        self.process.send_signal(signal.SIGUSR1)
        while time.monotonic() < deadline:
            if self.folder.board()[Word.HELD] and self._movement.moves(self.rig.parts()):
                return
            time.sleep(0.02)
        raise AssertionError(f"the step was not held: {self.told()}")

    def pids(self) -> dict[str, int]:
        """The processes of the run by their job."""
        board = self.folder.board()
        self._offset_ns = board[Word.START_NS] - board[Word.ORIGIN_NS]
        return {
            "daemon": self.process.pid,
            "cycle": board[Word.PID_CYCLE],
            "recorder": board[Word.PID_RECORDER],
        }

    @property
    def folder(self) -> RunFolder:
        """The run's folder in memory."""
        (path,) = (item for item in self._state.iterdir() if RunFolder.at(item).has_job)
        return RunFolder.at(path)

    def told(self) -> str:
        """What the run has printed for its operator."""
        self._log.flush()
        self._log.seek(0)
        return self._log.read().decode()

    def hit_recorder(self, number: signal.Signals) -> None:
        """Send ``number`` to the recorder; return once another records, or it is stopped."""
        board = self.folder.board()
        hit = board[Word.PID_RECORDER]
        os.kill(hit, number)
        deadline = time.monotonic() + END_S
        while number is not signal.SIGSTOP and (
            board[Word.PID_RECORDER] == hit or board[Word.RECORDER_STATE] != RecorderState.RECORDING
        ):
            assert time.monotonic() < deadline, self.told()
            time.sleep(0.01)

    def hit(self, victim: str, number: signal.Signals) -> Killed:
        """Send ``number`` to ``victim``, and wait until all has ended."""
        pids = self.pids()
        chosen = list(pids.values()) if victim == "all" else [pids[victim]]
        at_ns = time.monotonic_ns()
        for pid in chosen:
            with suppress(ProcessLookupError):  # ended by another that found one of them silent
                os.kill(pid, number)
        if victim == "recorder" and number is not signal.SIGSTOP:
            # The run goes on: what is asked is that nothing is missing in the end.
            time.sleep(1.5)
            self.process.send_signal(signal.SIGINT)
        elif victim == "recorder":
            time.sleep(0.5)
            self.process.send_signal(signal.SIGINT)
        safe_ns = self.wait_until_safe()
        self._wait_for_end(pids, stopped=number is signal.SIGSTOP and victim in ("daemon", "all"))
        return self._examine(at_ns, safe_ns)

    def end(self) -> None:
        """End what is left of it."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._log.close()

    def wait_until_safe(self) -> int:
        """Return when the last drive lost its torque."""
        deadline = time.monotonic() + END_S
        while time.monotonic() < deadline:
            parts: Mapping[str, Any] = self.rig.parts()
            since = [parts[name]["safe_since_ns"] for name in self._movement.drives]
            if all(since):
                return int(max(since))
            time.sleep(0.02)
        raise AssertionError(f"a drive still has torque: {self.rig.parts()}")

    def _wait_for_end(self, pids: Mapping[str, int], *, stopped: bool) -> None:
        """Wait until every process has ended; those that were stopped are then killed."""
        deadline = time.monotonic() + END_S
        if stopped:
            while alive(pids["cycle"]) and time.monotonic() < deadline:
                if (
                    Path(f"/proc/{pids['cycle']}/stat").read_text().rsplit(")")[-1].split()[0]
                    == "T"
                ):
                    break
                time.sleep(0.01)
            for pid in pids.values():
                if alive(pid):
                    os.kill(pid, signal.SIGKILL)
        while time.monotonic() < deadline:
            self.process.poll()
            if not any(alive(pid) for pid in pids.values()) and not self._recorder_lives():
                return
            time.sleep(0.01)
        raise AssertionError(f"the run did not end: {self.told()}")

    def _recorder_lives(self) -> bool:
        """Return whether a recorder that was started again still works."""
        for path in self._state.iterdir():
            folder = RunFolder.at(path)
            if folder.has_job and (pid := folder.board()[Word.PID_RECORDER]):
                return alive(pid)
        return False

    def _recover(self) -> None:
        """Recover the recording; refused as long as a helper of the run still ends."""
        place, name, deadline = self.recording.parent, self.recording.name, time.monotonic() + END_S
        while (done := rigd("recover", name, cwd=place, state=self._state)).code != Exit.OK:
            assert "is in use by" in done.err and time.monotonic() < deadline, done.err
            time.sleep(0.1)
        assert done.code == 0, done.err

    def _examine(self, at_ns: int, safe_ns: int) -> Killed:
        """Recover the recording as an operator would, and look for what is missing."""
        self._recover()
        recording = Recording.open(self.recording)
        servo = recording.read(self._movement.stream)
        unix_of_kill = at_ns + self._offset_ns  # on the clock of the run
        events = recording.events()
        ended = [e for e in events if e.kind == "run_end"]
        noticed = [e.t_ns for e in events if str(e.data.get("reason")).startswith("the daemon ")]
        return Killed(
            at_ns,
            (safe_ns - at_ns) * 1e-9,
            (noticed[0] - unix_of_kill) * 1e-9 if noticed else None,
            (int(servo["t_ns"][-1]) - unix_of_kill) * 1e-9,
            gaps(recording, self._movement.stream),
            self.process.returncode,
            str(ended[-1].data["state"]) if ended else "",
            self.told(),
        )


def gaps(recording: Recording, stream: str) -> int:
    """Return how many cycles ran that are missing in ``stream``, one run recorded."""
    cycles, rows = recording.read("cycle"), recording.read(stream)
    due_s = cycles["scheduled"]
    periods = np.diff(due_s)
    slots = np.rint(due_s / float(np.median(periods))).astype(np.int64)
    late = sum(int(e.data["missed_slots"]) for e in recording.events() if e.kind == "late")
    skipped = int(slots[-1] - slots[0]) + 1 - len(slots)
    controlled = np.count_nonzero(rows["t_ns"] <= cycles["t_ns"][-1])  # then it comes to rest
    return skipped - late + abs(int(controlled) - len(cycles))


def captured(recording: Recording, held_s: float) -> tuple[int, int]:
    """Return how many captured rows of `CAPTURING` are missing, and how many are there beyond them.

    The last ``held_s`` need not be there. A row at the edge of a capture may be either.
    """
    servo = recording.read("wheel_servo")
    times_s = (servo["t_ns"] - servo["t_ns"][0]) * 1e-9
    met_s = times_s[servo["current"] > 0.25]
    there = np.isin(servo["t_ns"], recording.read("longitudinal_belt")["t_ns"])
    since_s = times_s - met_s[:, None]
    edge_s = 1.5 * PERIOD_S
    inner = np.any((since_s >= edge_s - BEFORE_S) & (since_s <= AFTER_S - edge_s), axis=0)
    outer = np.any((since_s >= -edge_s - BEFORE_S) & (since_s <= AFTER_S + edge_s), axis=0)
    due = inner & (times_s < times_s[-1] - held_s)
    return int(np.count_nonzero(due & ~there)), int(np.count_nonzero(there & ~outer))


def kill_cycle(bench: WireRig, folder: Path, movement: Movement) -> tuple[Killed, float]:
    """Kill the cycle of a run in ``movement``; return what came of it, and stalls in s."""
    state = own_state(folder)
    run = Victim(bench, folder, state, movement)
    try:
        with witnessed() as lost_s:
            killed = run.hit("cycle", signal.SIGKILL)
            stalled_s = lost_s()
    finally:
        run.end()
    shutil.rmtree(state)
    return killed, stalled_s


def own_state(folder: Path) -> Path:
    """Return a state folder of its own below ``folder``, in memory if the usual one is."""
    path = state_folder() / f"test-{folder.name}-{os.getpid()}"
    path.mkdir(mode=0o700)
    return path


def bound_s(
    rig: WireRig, victim: str, number: signal.Signals, movement: Movement = SHAKING
) -> float:
    """Return after how long the drives must be without torque, by the rig file."""
    config = load_rig(rig.rig)
    watchdog = movement.watchdog_s
    stalled = 0.15  # what a host may be away for on top, and its report
    if victim == "recorder":
        return END_S  # the run goes on, and is ended by its operator
    if number is signal.SIGSTOP and victim == "daemon":
        return config.supervision.daemon_silence_s + stalled
    if number in (signal.SIGKILL, signal.SIGSTOP) and victim != "daemon":
        return watchdog + stalled
    return 2 * stalled  # to rest at the rate of the rig file, then safe
