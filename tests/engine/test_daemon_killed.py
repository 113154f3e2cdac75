"""A daemon that is killed: the cycle notices it at once, whatever it does just then."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.daemon.file_axis import word
from support.recordings.blocks import alive, until

from rigd.engine.shared import RunFolder, Word, state_folder

pytestmark = pytest.mark.usefixtures("own_state")

#: A daemon of two axes. A process that it leaves behind holds its end of each socket: the cycle
#: gets no end of file when the daemon ends, as from one whose memory the kernel still frees.
DAEMON = """
import os, sys, time
from pathlib import Path
from support.daemon import file_axis
from rigd.engine.play.control import Control
from rigd.engine.process.launch import launch
from rigd.engine.shared import Job, RunFolder
from rigd.engine.cycle.wiring import streams_of
from rigd.procedure.profiles.profiles import ConstantProfile
from rigd.procedure.program import CycleProgram, Recorded, Segment

rig = file_axis.two_axes(Path(sys.argv[1]), daemon_silence_s=60.0, **eval(sys.argv[2]))
streams = tuple(streams_of(rig))
folder = RunFolder.take(rig.name, command="test")
job = Job(rig.name, folder.path / "x.mcap", streams, time.time_ns())
folder.prepare(job, {stream.name: 50_000 for stream in streams})
record = {stream.name: Recorded() for stream in streams}
host = launch(rig, folder, job, Control(), record=record, finish=lambda: None)
if not os.fork():
    sys.stdin.read()
    os._exit(0)
reasons = host.open()
assert reasons == (), reasons
host.settle(5)
host.arm()
go = Segment("go", {"axis.speed": ConstantProfile(0.5)}, duration_s=600.0)
print(host.play(CycleProgram((go,))).reason)
host.make_safe()
host.close()
"""
PATIENCE_S = 60.0


@contextmanager
def daemon(path: Path, **options: object) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        [sys.executable, "-c", DAEMON, str(path), repr(options)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def is_told(path: Path, expected: str) -> Callable[[], bool]:
    return lambda: path.exists() and word(path) == expected


def cycle_of(path: Path) -> tuple[RunFolder, int]:
    """Return the folder of the run, and the process of its cycle."""
    (found,) = (item for item in state_folder().iterdir() if RunFolder.at(item).has_job)
    folder = RunFolder.at(found)
    return folder, folder.board()[Word.PID_CYCLE]


def faults(folder: RunFolder) -> list[str]:
    events = folder.event_ring("cycle").peek()
    return [str(event.data["reason"]) for event in events if event.kind == "fault"]


def test_nothing_is_proven_for_daemon_that_is_dead(tmp_path: Path) -> None:
    """Also a proof that waits ends: its device is made safe, and no other is enabled."""
    path = tmp_path / "axis"
    with daemon(path, proof_takes_s=PATIENCE_S) as process:
        until(is_told(path, "enabled for a proof"), PATIENCE_S)
        folder, cycle = cycle_of(path)
        began = time.monotonic()
        process.kill()
        until(lambda: not alive(cycle), PATIENCE_S)
        assert time.monotonic() - began < PATIENCE_S / 2
        assert word(path) == "safe"
        assert word(tmp_path / "second") == "safe"
        assert "watchdog" not in [event.kind for event in folder.event_ring("cycle").peek()]
        assert faults(folder) == ["the daemon has ended; the rig is made safe"]


def test_devices_are_left_while_daemon_dies(tmp_path: Path) -> None:
    path = tmp_path / "axis"
    with daemon(path, opens_in_s=PATIENCE_S) as process:
        until(path.exists, PATIENCE_S)
        _, cycle = cycle_of(path)
        process.kill()
        until(lambda: not alive(cycle), PATIENCE_S / 2)
        assert word(path) == "safe"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_signal_to_cycle_ends_proof_that_waits(tmp_path: Path, number: signal.Signals) -> None:
    path = tmp_path / "axis"
    with daemon(path, proof_takes_s=PATIENCE_S) as process:
        until(is_told(path, "enabled for a proof"), PATIENCE_S)
        folder, cycle = cycle_of(path)
        os.kill(cycle, number)
        until(lambda: not is_told(path, "enabled for a proof")(), PATIENCE_S / 2)
        process.wait(PATIENCE_S)
        assert word(path) in ("safe", "rescued")
        assert word(tmp_path / "second") in ("safe", "rescued")
        assert faults(folder)[0] == (
            f"{number.name} was sent to the cycle process; the rig is made safe"
        )


def test_killed_daemon_is_noticed_before_its_sockets_end(tmp_path: Path) -> None:
    path = tmp_path / "axis"
    with daemon(path) as process:
        until(is_told(path, "moving"), PATIENCE_S)
        folder, cycle = cycle_of(path)
        process.kill()
        until(lambda: not alive(cycle), PATIENCE_S)
        assert word(path) == "safe"
        assert faults(folder) == ["the daemon has ended; the rig is made safe"]


def test_daemon_that_is_stopped_is_not_dead(tmp_path: Path) -> None:
    """As on a machine whose other programs leave it no time: the run goes on."""
    path = tmp_path / "axis"
    with daemon(path) as process:
        until(is_told(path, "moving"), PATIENCE_S)
        folder, cycle = cycle_of(path)
        board = folder.board()
        os.kill(process.pid, signal.SIGSTOP)
        enough = board[Word.CYCLES] + 300
        until(lambda: board[Word.CYCLES] > enough, PATIENCE_S)
        assert word(path) == "moving"
        os.kill(process.pid, signal.SIGKILL)
        until(lambda: not alive(cycle), PATIENCE_S)
        assert word(path) == "safe"
