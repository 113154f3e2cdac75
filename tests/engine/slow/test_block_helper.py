"""The helper process of a block device: its rows, its faults, its death, the daemon's death."""

from __future__ import annotations

import fcntl
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.descriptors import beyond_select
from support.recordings.blocks import Counter, CounterConfig, alive, device_of, until

from rigd.model.errors import DeviceError, LinkError

from .conftest import ORIGIN_NS, START_NS, Place

Placed = Callable[..., Place]


def counter(**options: object) -> object:
    return device_of("daq", Counter, CounterConfig.model_validate(options))


def faulted(place: Place) -> str:
    until(lambda: place.helper.poll() is not None)
    return str(place.helper.poll())


def test_rows_reach_ring_and_newest_table(placed: Placed) -> None:
    place = placed(counter())
    place.helper.start()
    assert (place.helper.identity, place.helper.rate_hz) == ("counter 1", 2000.0)
    until(lambda: place.ring.head >= 50)
    assert place.helper.poll() is None
    place.helper.stop()
    rows = place.ring.drain()
    assert np.array_equal(rows["number"], np.arange(len(rows)))
    assert np.array_equal(rows["half"], rows["number"] / 2)
    assert np.array_equal(rows["status"], np.arange(len(rows)) // 10 + 1)
    assert np.all(np.diff(rows["t_ns"]) > 0)
    newest = place.slot.read()
    assert newest is not None
    t_ns, values = newest
    assert t_ns + START_NS - ORIGIN_NS == rows["t_ns"][-1]
    assert values == [rows["number"][-1], rows["half"][-1], rows["status"][-1]]
    assert t_ns <= time.monotonic_ns() + 1_000


def test_helper_starts_beyond_1024_descriptors(placed: Placed) -> None:
    with beyond_select():
        place = placed(counter())
        place.helper.start()
        assert place.helper.poll() is None


def test_device_that_cannot_open_reports_reason(placed: Placed) -> None:
    place = placed(counter(fault="absent"))
    with pytest.raises(LinkError, match=r"^daq: nobody answers") as caught:
        place.helper.start()
    assert caught.value.hint == "plug it in"
    assert not alive(place.helper.pid)


def test_device_that_cannot_start_is_refused(placed: Placed) -> None:
    place = placed(counter(fault="no start"))
    with pytest.raises(DeviceError, match=r"^daq: it cannot sample"):
        place.helper.start()
    assert not alive(place.helper.pid)


def test_helper_lives_before_it_is_judged(placed: Placed) -> None:
    """A device may start more slowly than a hang is allowed to last."""
    place = placed(counter(fault="slow start"))
    place.helper.start()
    assert place.slot.beat_ns > 0


def test_stop_ends_opening_of_helper(placed: Placed) -> None:
    place = placed(counter(fault="slow start"), stopped=lambda: True)
    with pytest.raises(DeviceError, match="daq was not opened: a stop was requested"):
        place.helper.start()
    assert not alive(place.helper.pid)


def test_helper_not_open_in_time_is_ended(placed: Placed) -> None:
    place = placed(counter())
    with pytest.raises(LinkError, match="daq was not open within 0 s"):
        place.helper.start(timeout_s=0.0)  # no interpreter starts in no time
    assert not alive(place.helper.pid)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("overrun", r"daq: samples were lost \(make the buffer larger\)$"),
        ("bug", "daq: its driver fails: ZeroDivisionError: a bug in the driver"),
        ("narrow", r"daq: the driver returned values of shape \(10, 2\) .* expected \(10, 3\)"),
        ("backwards", "daq: the driver returned times that do not increase"),
    ],
)
def test_fault_reaches_run_behind_rows_before_it(placed: Placed, fault: str, words: str) -> None:
    place = placed(counter(fault=fault, blocks=3))
    place.helper.start()
    reason = faulted(place)
    assert re.match(words, reason), reason
    assert place.helper.poll() == reason  # it stays
    assert len(place.ring.drain()) == 30
    assert ("Traceback" in place.log.read_text()) == (fault == "bug")


def test_first_failure_is_reported_not_the_following_one(placed: Placed) -> None:
    place = placed(counter(fault="sticky"))
    place.helper.start()
    assert faulted(place) == "daq: the sensor is broken"
    assert "OSError: the port is gone" in place.log.read_text()


def test_no_rows_are_no_fault_of_the_process(placed: Placed) -> None:
    """That a device is silent is seen in the cycle, by the age of its values."""
    place = placed(counter(fault="quiet", blocks=1), silence_s=30.0)
    place.helper.start()
    until(lambda: place.ring.head == 10)
    beat = place.slot.beat_ns
    until(lambda: place.slot.beat_ns > beat)
    assert place.helper.poll() is None


def test_killed_helper_is_reported_and_rows_are_kept(placed: Placed) -> None:
    place = placed(counter())
    place.helper.start()
    until(lambda: place.ring.head >= 20)
    os.kill(place.helper.pid, signal.SIGKILL)
    assert faulted(place) == "daq: its process was ended by SIGKILL"
    rows = place.ring.drain()
    assert len(rows) >= 20
    assert np.array_equal(rows["number"], np.arange(len(rows)))


@pytest.mark.parametrize("how", ["library", "SIGSTOP"])
def test_a_helper_that_hangs_is_reported_and_ended(placed: Placed, how: str) -> None:
    place = placed(counter(fault="hang" if how == "library" else ""), silence_s=0.5)
    place.helper.start()
    until(lambda: place.ring.head >= 20)
    if how == "SIGSTOP":
        os.kill(place.helper.pid, signal.SIGSTOP)
    assert "gave no sign of life for" in faulted(place)
    pid = place.helper.pid
    place.helper.stop()
    assert not alive(pid)


def test_daemon_that_was_away_does_not_blame_helper(
    placed: Placed, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = placed(counter(fault="hang", blocks=0), silence_s=1.0)
    place.helper.start()
    now = time.monotonic_ns()
    for ms in (0, 2900):  # the second look comes late: the host stood still, not the helper
        monkeypatch.setattr(
            "rigd.engine.slow.block_helper.monotonic_ns", lambda ms=ms: now + ms * 1_000_000
        )
        assert place.helper.poll() is None
    for ms in (3300, 3700):
        monkeypatch.setattr(
            "rigd.engine.slow.block_helper.monotonic_ns", lambda ms=ms: now + ms * 1_000_000
        )
        assert place.helper.poll() is None
    monkeypatch.setattr("rigd.engine.slow.block_helper.monotonic_ns", lambda: now + 4_100_000_000)
    assert "gave no sign of life for 1.2 s" in str(place.helper.poll())


def test_signals_of_a_terminal_do_not_reach_it(placed: Placed) -> None:
    place = placed(counter())
    place.helper.start()
    assert os.getsid(place.helper.pid) == place.helper.pid
    until(lambda: place.ring.head >= 10)
    for number in (signal.SIGINT, signal.SIGHUP):
        os.kill(place.helper.pid, number)
    head = place.ring.head
    until(lambda: place.ring.head >= head + 50)
    assert place.helper.poll() is None


def test_sigterm_closes_the_block_device(placed: Placed) -> None:
    place = placed(counter())
    place.helper.start()
    until(lambda: place.ring.head >= 10)
    os.kill(place.helper.pid, signal.SIGTERM)
    assert faulted(place) == "daq: its process ended by itself (exit code 0)"


_DAEMON = """
import sys, threading
from pathlib import Path
from support.recordings.blocks import Counter, CounterConfig, device_of
from rigd.engine.slow.block_helper import BlockHelper
folder, lock_fd, fault = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
device = device_of("daq", Counter, CounterConfig(fault=fault))
helper = BlockHelper(device, ring=folder / "rows.ring", table=folder / "latest",
    table_streams=[device.stream], start_ns=0, origin_ns=0, log=folder / "log", lock_fd=lock_fd)
helper.start()
print("started", flush=True)
threading.Event().wait()
"""


@pytest.mark.parametrize("fault", ["", "hang"])
def test_helper_ends_with_daemon_and_holds_rig_meanwhile(
    placed: Placed, tmp_path: Path, fault: str
) -> None:
    place = placed(counter(fault=fault))  # makes ring and table; its own helper is not started
    with (tmp_path / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        daemon = subprocess.Popen(
            [sys.executable, "-c", _DAEMON, tmp_path, str(lock.fileno()), fault],
            pass_fds=[lock.fileno()],
            stdout=subprocess.PIPE,
        )
    with daemon, (tmp_path / "lock").open("w") as other:

        def free() -> bool:
            try:
                fcntl.flock(other, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return False
            return True

        assert daemon.stdout is not None
        assert daemon.stdout.readline() == b"started\n"
        until(lambda: place.ring.head >= 20)
        assert not free()
        daemon.kill()
        until(free)
    assert place.ring.head >= 20


def test_table_or_ring_of_other_streams_is_refused(placed: Placed, tmp_path: Path) -> None:
    place = placed(counter())
    (tmp_path / "rows.ring").write_bytes(b"")
    with pytest.raises(DeviceError, match=r"daq: .*rows\.ring has another layout"):
        place.helper.start()
