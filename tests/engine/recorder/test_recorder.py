"""The recorder as a process: killed, stopped and asked to end while another process pushes."""

from __future__ import annotations

import json
import os
import random
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import ClassVar

import pytest
from support.commands.command import rigd
from support.engine.numbered import START_NS, check_numbered, own_events

from rigd.engine.recorder import Health, RecorderProcess, drain_leftovers
from rigd.engine.shared import Job, Phase, RecorderState, RunFolder, Word
from rigd.model import RecordingError
from rigd.model.errors import Blocked
from rigd.record import Recording, RecordingWriter

#: Stands for the cycle: numbered rows at about 4 kHz into three rings, until SIGTERM.
WRITER = """
import os, signal, sys, time
import numpy as np
from pathlib import Path
from rigd.engine.shared import RunFolder, Word
from rigd.model.rows import row_dtype

folder = RunFolder.at(Path(sys.argv[1]))
board, rings = folder.board(), folder.row_rings(folder.job)
start_ns, events = folder.job.start_ns, folder.event_ring("cycle")
block = np.zeros(20, row_dtype(rings["block"].stream))
stop = []
signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
board[Word.PID_CYCLE] = os.getpid()
n, due = 0, time.monotonic()
while not stop:
    for _ in range(20):
        t_ns = start_ns + n * 250_000
        rings["fast"].push(t_ns, (n, 1.0, 2.0, 3.0))
        if n % 10 == 0:
            rings["slow"].push(t_ns, (n // 10, 1))
        if n % 50 == 0:
            events.push(t_ns, "trip", 1, {"n": n // 50})
        block[n % 20] = (t_ns, n, -n)
        n += 1
    rings["block"].push_block(block)
    due += 0.005
    time.sleep(max(due - time.monotonic(), 0))
"""


class Bench:
    """A writer and a recorder on one folder; this process is the daemon."""

    def __init__(self, folder: RunFolder) -> None:
        self.folder = folder
        self.job = folder.job
        self.board = folder.board()
        self.rings = folder.row_rings(self.job)
        self.notes = folder.event_ring("daemon")
        self.noted = 0
        self.recorder = RecorderProcess(folder)
        command = [sys.executable, "-c", WRITER, str(folder.path)]
        self.writer = subprocess.Popen(command, pass_fds=[folder.lock_fd])

    def note(self) -> None:
        # At the time of an event of the cycle's: both must be kept.
        t_ns = START_NS + self.rings["fast"].head // 50 * 50 * 250_000
        self.notes.push(t_ns, "note", 1, {"n": self.noted})
        self.noted += 1

    def rows_later(self, count: int) -> None:
        """Return once ``count`` more rows were pushed."""
        head = self.rings["fast"].head + count
        wait_until(lambda: self.rings["fast"].head >= head)

    def end(self) -> None:
        self.writer.terminate()
        self.writer.wait()

    def check(self) -> None:
        """Everything that was pushed is in the recording, once."""
        counts = {name: ring.head for name, ring in self.rings.items()}
        assert counts["fast"] > 0
        assert all(ring.overruns == 0 for ring in self.rings.values())
        check_numbered(self.job.recording, counts)
        assert own_events(self.job.recording, "note") == list(range(self.noted))
        trips = own_events(self.job.recording, "trip")
        assert trips == list(range((counts["fast"] - 1) // 50 + 1))


@pytest.fixture
def bench(folder: RunFolder) -> Iterator[Bench]:
    bench = Bench(folder)
    yield bench
    bench.board[Word.PHASE] = Phase.ENDED
    bench.writer.kill()
    bench.writer.wait()
    if bench.recorder.pid and bench.recorder.poll() is not Health.ENDED:
        kill(bench.recorder.pid)


def wait_until(condition: Callable[[], object], timeout_s: float = 60.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "it never came"
        time.sleep(0.0005)


def kill(pid: int, number: int = signal.SIGKILL) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, number)


class Held:
    """A process that waits for a disk in the kernel: killed, it goes only once that answers."""

    started: ClassVar[list[Held]] = []

    def __init__(self, *_: object, **__: object) -> None:
        self.pid = os.getpid()
        self.killed, self.answers = False, threading.Event()
        self.started.append(self)

    def kill(self) -> None:
        self.killed = True

    def poll(self) -> int | None:
        return -9 if self.killed and self.answers.is_set() else None

    def wait(self, timeout: float | None = None) -> int:
        if timeout is None:
            assert threading.current_thread() is not threading.main_thread(), "waits for ever"
            self.answers.wait()
        elif self.poll() is None:
            raise subprocess.TimeoutExpired("recorder", timeout)
        return -9


def test_recorder_blocked_by_disk_does_not_block_daemon(
    folder: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(subprocess, "Popen", Held)
    Held.started.clear()
    recorder = RecorderProcess(folder)
    recorder.start()
    recorder.restart()
    assert Held.started[0].killed
    assert len(Held.started) == 1  # two would write to one file
    assert recorder.poll() is Health.WELL
    Held.started[0].answers.set()
    assert recorder.poll() is Health.DIED
    recorder.restart()
    assert len(Held.started) == 2


def test_repeatedly_killed_recorder_loses_nothing(bench: Bench) -> None:
    random_ = random.Random(20261121)
    bench.recorder.start()
    for round_ in range(6):
        if round_ % 3:  # else it dies while it starts
            bench.recorder.wait_until_recording()
        bench.note()
        bench.rows_later(random_.randrange(1, 800))
        if round_ % 2:
            kill(bench.recorder.pid)
            wait_until(lambda: bench.recorder.poll() is Health.DIED)
        else:
            kill(bench.recorder.pid, signal.SIGSTOP)
        bench.note()
        bench.recorder.restart()
    bench.recorder.wait_until_recording()
    bench.end()
    bench.notes.push(START_NS + 10**12, "run_end", -1, {"state": "done", "reason": "played"})
    bench.board[Word.PHASE] = Phase.ENDED
    bench.recorder.finish()
    bench.check()
    info = Recording.open(bench.job.recording).info
    assert (info.state, info.reason) == ("done", "played")
    assert [path.name for path in bench.folder.path.iterdir()] == ["lock"]


def test_a_recorder_that_hangs_is_seen_and_replaced(bench: Bench) -> None:
    bench.recorder.start()
    bench.recorder.wait_until_recording()
    assert bench.recorder.poll() is Health.WELL
    kill(bench.recorder.pid, signal.SIGSTOP)
    wait_until(lambda: bench.recorder.poll(silence_s=0.5) is Health.SILENT)
    bench.recorder.restart()
    bench.recorder.wait_until_recording()
    bench.rows_later(10)
    bench.end()
    bench.board[Word.PHASE] = Phase.ENDED
    bench.recorder.finish()
    bench.check()


def test_recorder_killed_at_run_end_is_replaced(bench: Bench) -> None:
    bench.recorder.start()
    bench.recorder.wait_until_recording()
    bench.rows_later(100)
    bench.end()
    kill(bench.recorder.pid)
    bench.board[Word.PHASE] = Phase.ENDED
    bench.recorder.finish()
    bench.check()


def test_after_writer_and_recorder_die_next_start_completes(bench: Bench) -> None:
    bench.recorder.start()
    bench.recorder.wait_until_recording()
    bench.rows_later(random.Random(7).randrange(200, 1500))
    bench.note()
    kill(bench.recorder.pid)
    bench.rows_later(300)
    bench.writer.kill()
    bench.writer.wait()
    wait_until(lambda: bench.recorder.poll() is Health.DIED)
    assert drain_leftovers(bench.folder) == bench.job.recording
    counts = {name: ring.head for name, ring in bench.rings.items()}
    check_numbered(bench.job.recording, counts)
    assert own_events(bench.job.recording, "note") == [0]
    info = Recording.open(bench.job.recording).info
    assert (info.state, info.reason) == ("interrupted", "all processes of the run were killed")


def test_sigterm_writes_everything_and_leaves_rest_to_successor(bench: Bench) -> None:
    bench.recorder.start()
    bench.recorder.wait_until_recording()
    for number in (signal.SIGINT, signal.SIGHUP):
        kill(bench.recorder.pid, number)
    bench.rows_later(100)
    before = bench.rings["fast"].head
    kill(bench.recorder.pid, signal.SIGTERM)
    wait_until(lambda: bench.recorder.poll() is Health.DIED)
    assert bench.recorder.state is RecorderState.STOPPED
    assert Recording.open(bench.job.recording).count("fast") >= before
    bench.rows_later(100)
    bench.recorder.restart()
    bench.recorder.wait_until_recording()
    bench.end()
    bench.board[Word.PHASE] = Phase.ENDED
    bench.recorder.finish()
    bench.check()


def test_recorder_ends_when_daemon_and_cycle_are_gone(bench: Bench) -> None:
    with subprocess.Popen(["cat"], stdin=subprocess.PIPE) as daemon:
        bench.recorder.start()
        bench.board[Word.PID_DAEMON] = daemon.pid
        bench.recorder.wait_until_recording()
        bench.rows_later(1)  # the cycle is there
        daemon.kill()
        daemon.wait()
        # The cycle is still there, and so is the recorder.
        bench.rows_later(4000)
        assert bench.recorder.poll() is Health.WELL
        bench.writer.kill()
        bench.writer.wait()
        wait_until(lambda: bench.recorder.poll() is Health.ENDED)
    counts = {name: ring.head for name, ring in bench.rings.items()}
    check_numbered(bench.job.recording, counts)
    info = Recording.open(bench.job.recording).info
    assert (info.state, info.reason) == ("interrupted", "the processes of the run were killed")
    assert not bench.folder.has_job


@contextmanager
def files_end_at(size: int) -> Iterator[None]:
    """Let a child that is started meanwhile write no file beyond ``size``, as a full disk would."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_full_disk_is_reported_and_no_row_released(bench: Bench) -> None:
    with files_end_at(150_000):
        bench.recorder.start()
    wait_until(lambda: bench.recorder.poll() is Health.FAILED)
    beat = bench.board[Word.BEAT_RECORDER]
    wait_until(lambda: bench.board[Word.BEAT_RECORDER] > beat)  # it is alive to report
    bench.rows_later(100)
    bench.end()
    bench.board[Word.PHASE] = Phase.ENDED
    with pytest.raises(RecordingError, match=r"cannot write .*run\.mcap: File too large") as caught:
        bench.recorder.finish()
    assert "Free space" in (caught.value.hint or "")
    assert f"rigd run --resume {bench.job.recording}" in (caught.value.hint or "")
    assert Recording.open(bench.job.recording).info.state == "interrupted"
    # There is room again: the next start, or `rigd recover`, adds what the rings still hold.
    drain_leftovers(bench.folder)
    bench.check()


def test_recording_that_cannot_be_made_is_reported_immediately(folder: RunFolder, job: Job) -> None:
    job.recording.write_bytes(b"")
    recorder = RecorderProcess(folder)
    recorder.start()
    with pytest.raises(RecordingError, match="exists already"):
        recorder.wait_until_recording()
    assert job.recording.read_bytes() == b""


def test_recorder_that_cannot_start_reports_reason(folder: RunFolder) -> None:
    recorder = RecorderProcess(folder)
    (folder.path / "board").unlink()
    recorder.start()
    with pytest.raises(RecordingError, match=r"exit code 1.*board"):
        recorder.wait_until_recording()


def test_rig_stays_locked_until_its_recorder_is_gone(bench: Bench) -> None:
    bench.recorder.start()
    bench.recorder.wait_until_recording()
    bench.end()
    bench.folder.release()
    with pytest.raises(Blocked, match="rig bench is in use by"):
        RunFolder.take("bench", command="test")
    bench.board[Word.PHASE] = Phase.ENDED
    bench.recorder.finish()
    RunFolder.take("bench", command="test").release()


@pytest.mark.parametrize("named", [True, False])
def test_rigd_recover_completes_a_killed_run(bench: Bench, named: bool, tmp_path: Path) -> None:
    bench.recorder.start()
    bench.recorder.wait_until_recording()
    bench.rows_later(500)
    kill(bench.recorder.pid)
    bench.rows_later(100)
    in_use = rigd("recover", bench.job.recording, cwd=tmp_path)
    assert in_use.code == 7
    assert "rig bench is in use by process" in in_use.err
    bench.writer.kill()
    bench.writer.wait()
    wait_until(lambda: bench.recorder.poll() is Health.DIED)
    bench.folder.release()
    done = rigd("recover", *([bench.job.recording] if named else []), cwd=tmp_path)
    assert (done.code, done.err) == (0, "")
    assert "run.mcap: completed with samples that its killed run left in memory" in done.out
    counts = {name: ring.head for name, ring in bench.rings.items()}
    check_numbered(bench.job.recording, counts)
    again = rigd("recover", cwd=tmp_path)
    assert (again.code, again.out) == (0, "there is no recording of a killed run to complete\n")


def test_run_killed_before_its_file_needs_no_repair(
    folder: RunFolder, job: Job, tmp_path: Path
) -> None:
    folder.release()
    done = rigd("recover", cwd=tmp_path)
    assert (done.code, done.err) == (0, "")
    assert done.out == f"{job.recording}: its run was killed before it recorded anything\n"
    again = rigd("recover", cwd=tmp_path)
    assert again.out == "there is no recording of a killed run to complete\n"


def test_a_job_that_cannot_be_read_is_named(folder: RunFolder, job: Job, tmp_path: Path) -> None:
    folder.release()
    (folder.path / "job.json").write_text(json.dumps({"rig": "bench"}))
    done = rigd("recover", cwd=tmp_path)
    assert done.code == 7
    assert str(folder.path) in done.err
    assert Path(folder.path, "rows-0.ring").exists()
    # It keeps no other recording from being repaired, but is named there too.
    RecordingWriter.create(
        job.recording, streams=job.streams, metadata={}, attachments=(), start_ns=START_NS
    ).close()
    done = rigd("recover", job.recording, cwd=tmp_path)
    assert done.code == 7
    assert str(folder.path) in done.err
    assert done.out == f"{job.recording}: intact\n"
