"""A recorder killed at any step of a transfer: the next one adds what is missing, and no more."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.engine.numbered import CAPACITIES, START_NS, STREAMS, check_numbered, own_events

from rigd.engine.recorder import drain_leftovers
from rigd.engine.recorder.transfer import Transfer
from rigd.engine.shared import EventRing, Job, RowRing, RunFolder
from rigd.model import RecordingError
from rigd.model.rows import row_dtype
from rigd.record import Event, Recording, RecordingWriter


class Source:
    """Pushes numbered rows and events, as cycle and daemon do."""

    def __init__(self, folder: RunFolder) -> None:
        self.rows = folder.row_rings(folder.job)
        self.cycle, self.daemon = folder.event_ring("cycle"), folder.event_ring("daemon")
        self.count = 0

    def push(self, count: int) -> None:
        block = np.zeros(count, row_dtype(STREAMS[2]))
        for i in range(self.count, self.count + count):
            t_ns = START_NS + i * 1_000_000
            self.rows["fast"].push(t_ns, (i, 0.0, 0.0, 0.0))
            self.rows["slow"].push(t_ns, (i, i % 7))
            block[i - self.count] = (t_ns, i, -i)
            # Both at one time, and twice the same: neither may be taken for the other.
            self.cycle.push(t_ns, "trip", -1, {"n": i // 2})
            self.daemon.push(t_ns, "note", 3, {"n": i})
        self.rows["block"].push_block(block)
        self.count += count


def die_at(step: int, folder: RunFolder, work: Callable[[Transfer], None]) -> bool:
    """Do ``work`` in a child that kills itself before the given step; return whether it did."""
    child = os.fork()
    if child == 0:
        steps = 0

        def counting(method: Callable[..., Any]) -> Callable[..., Any]:
            def counted(*args: Any, **options: Any) -> Any:
                nonlocal steps
                steps += 1
                if steps == step:
                    os.kill(os.getpid(), signal.SIGKILL)
                return method(*args, **options)

            return counted

        for owner, names in (
            (RecordingWriter, ("write", "flush", "close")),
            (RowRing, ("release",)),
            (EventRing, ("release",)),
        ):
            for name in names:
                setattr(owner, name, counting(getattr(owner, name)))
        transfer = Transfer(RunFolder.at(folder.path))
        transfer.open()
        work(transfer)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) or status == 0
    return os.WIFSIGNALED(status)


def check(job: Job, count: int) -> None:
    check_numbered(job.recording, {"fast": count, "slow": count, "block": count})
    assert own_events(job.recording, "note") == list(range(count))
    assert own_events(job.recording, "trip") == [i // 2 for i in range(count)]


def restarts(job: Job) -> list[Event]:
    events = Recording.open(job.recording).events()
    return [event for event in events if event.kind == "recorder_restarted"]


@pytest.mark.parametrize("step", range(1, 20))
def test_kill_between_any_two_steps_loses_nothing(step: int, folder: RunFolder, job: Job) -> None:
    source = Source(folder)
    source.push(40)

    def work(transfer: Transfer) -> None:
        transfer.move()
        source.push(25)  # rings are shared: the test sees it too
        transfer.move()

    killed = die_at(step, folder, work)
    # A child that came to push has done so for us as well.
    source = Source(folder)
    source.count = source.rows["fast"].head
    assert source.count in (40, 65)
    assert killed == (step <= 18)
    source.push(10)
    again = die_at(step, folder, lambda transfer: transfer.move())
    source.push(5)
    assert drain_leftovers(folder) == job.recording
    check(job, source.count)
    assert not folder.has_job
    info = Recording.open(job.recording).info
    assert info.state == "interrupted"
    assert again or "killed" in info.reason


@pytest.mark.parametrize("step", [1, 2, 3])
def test_kill_while_closing_loses_nothing(step: int, folder: RunFolder, job: Job) -> None:
    source = Source(folder)
    source.push(40)
    source.daemon.push(START_NS + 10**9, "run_end", -1, {"state": "done", "reason": "all played"})

    def work(transfer: Transfer) -> None:
        transfer.move()
        transfer.finish("not said")

    die_at(9 + step, folder, work)
    assert drain_leftovers(folder) == job.recording
    check(job, 40)
    ends = [event for event in Recording.open(job.recording).events() if event.kind == "run_end"]
    assert [end.data["state"] for end in ends] == ["done"]


def test_resumed_recording_is_counted_from_where_it_was(folder: RunFolder, job: Job) -> None:
    source = Source(folder)
    source.push(30)
    drain_leftovers(folder)
    resumed = replace(job, resume=True, metadata={"resumed": {"trials": "1"}}, attachments=())
    folder.prepare(resumed, CAPACITIES)
    source = Source(folder)
    source.count = 30
    source.push(20)
    assert die_at(14, folder, lambda transfer: transfer.move())
    assert not restarts(job)  # to go on is not to start again
    source.push(10)
    drain_leftovers(folder)
    check(job, 60)
    assert len(restarts(job)) == 1
    recording = Recording.open(job.recording)
    assert recording.metadata["resumed"] == {"trials": "1"}
    names = [index.name for index in recording.contents.metadata]
    assert names.count("resumed") == 1
    assert list(recording.attachments) == ["rig.yaml"]


def test_drain_without_rows_leaves_no_file(folder: RunFolder, job: Job) -> None:
    assert drain_leftovers(folder) is None
    assert not job.recording.exists()
    assert not folder.has_job


def test_file_that_is_already_there_is_never_touched(folder: RunFolder, job: Job) -> None:
    job.recording.write_bytes(b"precious")
    with pytest.raises(RecordingError, match="exists already"):
        Transfer(folder).open()
    assert job.recording.read_bytes() == b"precious"


def test_unreadable_ring_error_names_folder_to_remove(folder: RunFolder) -> None:
    os.truncate(folder.path / "rows-0.ring", 0)
    with pytest.raises(RecordingError, match="another layout") as refused:
        drain_leftovers(folder)
    assert f"{folder.path}; to discard them, remove it" in str(refused.value)
    assert folder.has_job  # nothing is given up unasked


def test_run_still_writing_is_not_offered_for_removal(
    folder: RunFolder, job: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigd.engine.recorder.transfer._PATIENCE_S", 0.1)
    alive = Transfer(folder)
    alive.open()  # as a run with a removed lock file
    with pytest.raises(RecordingError, match="being written by another process") as refused:
        drain_leftovers(folder)
    assert "remove it" not in str(refused.value)
    alive.close()
    assert drain_leftovers(folder) == job.recording


def test_kill_while_creating_file_loses_nothing(folder: RunFolder, job: Job) -> None:
    source = Source(folder)
    source.push(10)
    transfer = Transfer(folder)
    transfer.open()
    transfer.close()
    for size in (0, 5):
        os.truncate(job.recording, size)
        transfer = Transfer(folder)
        transfer.open()
        transfer.close()
    drain_leftovers(folder)
    check(job, 10)
    torn = job.recording.with_name("run.mcap.torn")
    assert torn.stat().st_size == 5


def test_other_recording_of_same_name_is_not_extended(folder: RunFolder, job: Job) -> None:
    Source(folder).push(10)
    assert die_at(5, folder, lambda transfer: transfer.move())
    job.recording.unlink()
    RecordingWriter.create(
        job.recording, streams=STREAMS, metadata={}, attachments=(), start_ns=START_NS + 1
    ).close()
    with pytest.raises(RecordingError, match="is not the recording that the rings") as caught:
        drain_leftovers(folder)
    assert f"{folder.path}; to discard them, remove it" in (caught.value.hint or "")
    assert Recording.open(job.recording).count("fast") == 0
    assert folder.has_job


def test_rows_missing_from_file_are_reported(folder: RunFolder, job: Job) -> None:
    source = Source(folder)
    source.push(10)
    transfer = Transfer(folder)
    transfer.open()
    transfer.pause()
    job.recording.unlink()
    source.push(5)
    drain_leftovers(folder)
    recording = Recording.open(job.recording)
    assert recording.read("fast")["c0"].tolist() == [10, 11, 12, 13, 14]
    (event,) = restarts(job)
    assert event.data["rows_lost"] == {"fast": 10, "slow": 10, "block": 10}
    assert event.data["events_lost"] == 20


def test_overrun_is_recorded_with_lost_rows(folder: RunFolder, job: Job) -> None:
    ring = folder.row_rings(job)["slow"]
    for i in range(CAPACITIES["slow"] + 7):
        ring.push(START_NS + i, (i, 0))
    drain_leftovers(folder)
    check_numbered(job.recording, {"slow": CAPACITIES["slow"]})
    (event,) = [item for item in Recording.open(job.recording).events() if item.kind == "overrun"]
    assert (event.data["rows"], event.data["events"]) == ({"slow": 7}, 0)


def test_reader_holding_file_briefly_is_waited_for(folder: RunFolder, job: Job) -> None:
    import fcntl
    import threading

    source = Source(folder)
    source.push(10)
    transfer = Transfer(folder)
    transfer.open()
    transfer.pause()
    with job.recording.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_SH)
        timer = threading.Timer(0.2, lambda: fcntl.flock(held, fcntl.LOCK_UN))
        timer.start()
        again = Transfer(folder)
        again.open()
        timer.join()
        again.close()
