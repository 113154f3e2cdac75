"""Another process: whether it has been killed, before the kernel has cleared it away."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from rigd.model.machine.other_process import OtherProcess, child_ending, how_ended, shows_end

#: Some lines of /proc/PID/stat, cut after the pending signals: a process that sleeps, one that was
#: stopped by SIGSTOP, one with SIGKILL pending, one that exits, one that is not reaped.
SLEEPING = b"71 (a) b) S 1 71 71 0 -1 4194304 9 0 0 0 0 0 0 0 20 0 11 0 5 9 9 9 1 1 0 0 0 0 0 0 0 0"
STOPPED = SLEEPING.replace(b") S", b") T")
KILLED = SLEEPING.replace(b"9 9 9 1 1 0 0 0 0", b"9 9 9 1 1 0 0 0 256")
EXITING = SLEEPING.replace(b"4194304", b"4195332")
ZOMBIE = SLEEPING.replace(b") S", b") Z")


@contextmanager
def child(code: str) -> Iterator[subprocess.Popen[str]]:
    pipe = subprocess.PIPE
    process = subprocess.Popen([sys.executable, "-c", code], stdin=pipe, stdout=pipe, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (0, "ended by itself (exit code 0)"),
        (7, "ended by itself (exit code 7)"),
        (-9, "was ended by SIGKILL"),
        (-40, "was ended by signal 40"),
    ],
)
def test_exit_code_is_put_in_words(code: int, words: str) -> None:
    assert how_ended(code) == words


@pytest.mark.parametrize(
    ("stat", "ends"),
    [(SLEEPING, False), (STOPPED, False), (KILLED, True), (EXITING, True), (ZOMBIE, True)],
    ids=["sleeping", "stopped", "killed", "exiting", "zombie"],
)
def test_line_of_proc_shows_whether_process_ends(stat: bytes, ends: bool) -> None:
    assert shows_end(stat) is ends


def test_killed_process_shows_at_once_stopped_does_not() -> None:
    with child("print(flush=True); input()") as process:
        assert process.stdout is not None
        process.stdout.readline()
        other = OtherProcess(process.pid)
        assert not other.ending()
        assert not other.ended()
        os.kill(process.pid, signal.SIGSTOP)
        os.waitpid(process.pid, os.WUNTRACED)
        assert not other.ending()
        assert not child_ending(process.pid)
        os.kill(process.pid, signal.SIGKILL)
        assert other.ending()  # not some time after
        assert child_ending(process.pid)
        assert other.ended(60.0)
        process.wait()
        assert other.ending()
        assert other.ended()


def test_process_that_is_gone_has_ended() -> None:
    with child("") as process:
        process.wait()
        other = OtherProcess(process.pid)
        assert other.ending()
        assert other.ended()
        assert not child_ending(process.pid)


def test_end_of_big_process_shows_before_its_socket() -> None:
    """While threads of it still free its memory, a pipe of it is open."""
    big = (
        "import threading, time\n"
        "held = bytearray(200_000_000); held[::4096] = bytes(len(held[::4096]))\n"
        "for _ in range(8): threading.Thread(target=time.sleep, args=(60,), daemon=True).start()\n"
        "print(flush=True); time.sleep(60)"
    )
    with child(big) as process:
        assert process.stdout is not None
        process.stdout.readline()
        other = OtherProcess(process.pid)
        began = time.monotonic()
        os.kill(process.pid, signal.SIGKILL)
        assert other.ending()
        seen_s = time.monotonic() - began
        assert process.stdout.read() == ""
        assert seen_s < time.monotonic() - began
