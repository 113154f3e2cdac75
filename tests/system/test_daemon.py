"""The daemon as a process: started, steered over the network, killed, and started again.

On the shipped rig with its devices simulated at the wire: after any event no drive keeps its
torque, and no sample is lost.
"""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from support.commands.command import rigd
from support.daemon.process import Daemon, listening, until_gone
from support.faults.killing import QUARTER, gaps, own_state
from support.faults.stalls import witnessed
from support.wire import WireRig, free_ports, wire_rig

from rigd.model.errors import Exit
from rigd.record import Recording
from rigd.remote.protocol.limits import LEASE_S

#: A crowded machine does everything within this.
PATIENCE_S = 90.0
DRIVES = ("wheel_servo", "longitudinal_belt", "lateral_belt")
NAME = "wire-daemon"

#: The wheel turns to and fro in each of three trials, while the belt holds the carriage.
SHAKE = """\
procedure: shake
title: Moves, three times
doc: For tests.
parameters:
  time: {doc: How long, unit: s, default: 2 s, max: 7200 s}
repeats: 3
trial:
  steps:
    - step: shake
      set: {wheel_servo.current: {sine: {amplitude: 0.3 A, frequency: 2 Hz}}}
      for: ${time}
finish:
  - step: hold
    set: {wheel_servo.current: 0 A}
    for: 0.2 s
"""

Start = Callable[..., Daemon]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    """The rig with every device."""
    # A stall of 100 ms would let the drives end what is to go on.
    patient = QUARTER | {"watchdog: 100 ms": "watchdog: 300 ms"}
    with wire_rig(tmp_path_factory.mktemp("wire"), NAME, patient) as rig:
        listening(rig.rig, free_ports(1)[0])
        yield rig


@pytest.fixture(scope="module")
def bench(whole: WireRig) -> WireRig:
    """The same without the card, which takes a process more for each run."""
    return whole.without("accelerometer")


def started(rig: WireRig, folder: Path, state: Path) -> Daemon:
    """Start the daemon of a rig; return it once it serves."""
    endpoint = rig.rig.read_text().rpartition("listen: [")[2].partition("]")[0]
    daemon = Daemon(rig.rig, NAME, endpoint, folder, state)
    daemon.notified("READY=1")
    return daemon


@pytest.fixture(scope="module")
def idle() -> Iterator[list[Daemon]]:
    """The daemon that tests share, until one needs the rig for its own."""
    serving: list[Daemon] = []
    yield serving
    end(serving)


def end(serving: list[Daemon]) -> None:
    for item in serving:
        item.__exit__(None, None, None)
    for state in {item.state for item in serving}:
        shutil.rmtree(state)
    serving.clear()


@pytest.fixture
def daemon(
    idle: list[Daemon], bench: WireRig, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Daemon]:
    """A daemon that serves an idle rig, and is left so."""
    if not idle:
        folder = tmp_path_factory.mktemp("shared")
        idle.append(started(bench, folder, own_state(folder)))
    assert idle[0].status["state"] == "idle"
    yield idle[0]
    assert idle[0].status["state"] == "idle"


@pytest.fixture
def start(idle: list[Daemon], bench: WireRig, tmp_path: Path) -> Iterator[Start]:
    """Return what starts a daemon of the test's own, of another rig file if need be."""
    end(idle)
    state, serving = own_state(tmp_path), list[Daemon]()

    def serve(rig: WireRig = bench) -> Daemon:
        serving.append(started(rig, tmp_path, state))
        return serving[-1]

    yield serve
    end(serving)


@contextmanager
def safe_within(bench: WireRig, time_s: float) -> Iterator[None]:
    """Do what ends a run; so long after, and what the machine stalls, no drive has torque."""
    since = time.monotonic()
    with witnessed() as lost_s:
        yield
        while not all(times := [bench.parts()[name]["safe_since_ns"] for name in DRIVES]):
            assert time.monotonic() - since < PATIENCE_S, bench.parts()
            time.sleep(0.01)
        assert max(times) * 1e-9 - since < time_s + lost_s()


def moving(bench: WireRig) -> bool:
    servo = bench.parts()["wheel_servo"]
    return bool(servo["enabled"] and abs(servo["current"]) > 0.01)


def begin(daemon: Daemon, bench: WireRig, **args: object) -> Path:
    """Start a run, and return its recording once the wheel moves."""
    recording = daemon.start(SHAKE, **args)
    daemon.until(lambda status: status["step"] == "shake" and moving(bench))
    return recording


def ending(daemon: Daemon, recording: Path, *, steered: bool = True) -> dict[str, Any]:
    """Wait for the end of a run, and return its part of the status."""
    status = daemon.until(
        lambda status: status["last"] and status["last"]["run"] == recording.name, steered=steered
    )
    last: dict[str, Any] = status["last"]
    return last


def last_row_ns(recording: Recording) -> int:
    """Return when the last row was taken, by the clock of the run."""
    return int(recording.read("wheel_servo")["t_ns"][-1])


def test_a_run_is_steered_over_the_network(daemon: Daemon) -> None:
    recording = daemon.start(SHAKE, set={"time": "0.5 s"})
    assert ending(daemon, recording)["ending"] == "complete"
    assert daemon.request("ask", "runs")["runs"][0]["state"] == "complete"
    latest = daemon.request("ask", "latest")["values"]
    assert "wheel_servo.current" in latest
    assert gaps(Recording.open(recording), "wheel_servo") == 0


def test_service_manager_gets_signs_of_life(daemon: Daemon) -> None:
    daemon.notified("WATCHDOG=1\nSTATUS=idle", times=3)
    recording = daemon.start(SHAKE, set={"time": "0.5 s"})
    daemon.notified("WATCHDOG=1\nSTATUS=shake: running")
    ending(daemon, recording)


def test_a_client_that_is_killed_stops_the_run(daemon: Daemon, bench: WireRig) -> None:
    recording = begin(daemon, bench, set={"time": "7200 s"})
    with safe_within(bench, LEASE_S + 10.0):
        daemon.kill_client()
    last = ending(daemon, recording, steered=False)
    assert last["ending"] == "stopped", last["reason"]
    assert "alice, who steered this run, gave no sign of life" in last["reason"]
    assert Recording.open(recording).info.state == "stopped"


def test_one_rig_has_one_daemon_and_one_run(daemon: Daemon, bench: WireRig, tmp_path: Path) -> None:
    for command in (
        ["serve", "--rig", str(bench.rig), "--no-panel"],
        ["run", "quick", "--rig", str(bench.rig)],
    ):
        refused = rigd(*command, cwd=tmp_path, state=daemon.state)
        assert refused.code == Exit.BLOCKED, refused.err
        assert f"in use by process {daemon.process.pid} (rigd serve)" in refused.err
        assert f"rigd remote start PROCEDURE --rig {NAME}" in refused.err


@pytest.mark.parametrize(("times", "ending"), [(1, "stopped"), (2, "aborted")])
def test_a_signal_ends_the_run_then_the_daemon(
    start: Start, bench: WireRig, times: int, ending: str
) -> None:
    daemon = start()
    recording = begin(daemon, bench, set={"time": "7200 s"})
    pids = daemon.pids()
    with safe_within(bench, 10.0):
        for _ in range(times):
            daemon.signal(signal.SIGTERM)
            time.sleep(0.01)  # two at once are one
    assert daemon.ended() == 0
    daemon.notified("STOPPING=1")
    until_gone(pids)
    info = Recording.open(recording).info
    assert info.state == ending
    assert info.reason.startswith("stopped by SIGTERM")
    assert gaps(Recording.open(recording), "wheel_servo") == 0


def test_killed_daemon_leaves_safe_rig_for_next(start: Start, bench: WireRig) -> None:
    daemon = start()
    recording = begin(daemon, bench, set={"time": "1.5 s"})
    daemon.until(lambda status: status["trials_done"] == 1 and status["step"] == "shake")
    pids, killed_ns = daemon.pids(), daemon.now_ns()
    with safe_within(bench, 0.5):
        daemon.signal(signal.SIGKILL)
        daemon.process.wait()

    # At once, as a service manager would: what the killed one has started may still be ending.
    again = start()
    until_gone(pids)
    (offered,) = again.status["interrupted"]
    assert (offered["run"], offered["trials_done"], offered["trials_total"]) == (
        recording.name, 1, 3,
    )  # fmt: skip
    killed = Recording.open(recording)
    assert gaps(killed, "wheel_servo") == 0
    assert last_row_ns(killed) > killed_ns  # the way to rest is in the file
    assert killed.info.state == "interrupted"

    again.request("cmd", "lease_take")
    assert again.request("cmd", "resume_run", run=recording.name)["run"] == recording.name
    status = again.until(lambda status: status["last"])
    assert status["last"]["ending"] == "complete", status["last"]
    assert status["interrupted"] == []
    done = [trial.number for trial in Recording.open(recording).info.trials if trial.complete]
    assert sorted(done) == [1, 2, 3]


def test_all_processes_killed_at_once_lose_no_sample(start: Start, whole: WireRig) -> None:
    daemon = start(whole)
    recording = begin(daemon, whole, set={"time": "7200 s"})
    pids, left = daemon.pids(), daemon.folder
    with safe_within(whole, 0.5):  # by the drives' own watchdogs
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        daemon.process.wait()
    until_gone(pids)
    taken = {name: ring.head for name, ring in left.row_rings(left.job).items()}

    again = start(whole)
    assert f"{recording.name}: samples that a killed run left in memory were added" in [
        notice["text"] for notice in again.status["notices"]
    ]
    (offered,) = again.status["interrupted"]
    assert offered["run"] == recording.name
    assert gaps(Recording.open(recording), "wheel_servo") == 0
    recovered = Recording.open(recording)
    assert {name: len(recovered.read(name)) for name in taken} == taken
