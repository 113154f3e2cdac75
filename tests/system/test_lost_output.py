"""A screen that cannot be written: each form of a run is played to its end, without a bug."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from support import warm
from support.commands.command import rigd
from support.commands.terminal import Terminal

from rigd.record import Recording

SHORT = """\
procedure: short
title: Short
doc: For tests.
trial:
  steps:
    - {step: rest, set: {wheel_servo.current: 0 A}, for: 0.2 s}
"""
RUN = ("run", "short.yaml", "--rig", "lugre-1")
#: Each form of a run, by the words of its command; jog and a pace of 1 play in processes.
FORMS = {
    "virtual": RUN,
    "paced": (*RUN, "--pace", "2"),
    "real time": (*RUN, "--pace", "1"),
    "json": (*RUN, "--json"),
    "quiet": (*RUN, "--quiet"),
    "jog": ("jog", "longitudinal_belt.engaged=1", "--rig", "lugre-1", "--for", "0.1 s"),
}


@contextmanager
def unread_pipe() -> Iterator[int]:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        yield writer
    finally:
        os.close(writer)


@contextmanager
def full_disk() -> Iterator[int]:
    with Path("/dev/full").open("wb") as full:
        yield full.fileno()


@contextmanager
def closed_terminal() -> Iterator[int]:
    """Yield a terminal that is gone, as ssh leaves it: each write is EIO."""
    master, slave = pty.openpty()
    os.close(master)
    try:
        yield slave
    finally:
        os.close(slave)


LOST = {"pipe": unread_pipe, "disk": full_disk, "terminal": closed_terminal}


def ended(words: tuple[str, ...], cwd: Path, out: int, err: int) -> int:
    """Run a command on these streams; return its exit code."""
    with Path(os.devnull).open("rb") as nothing:
        if warm.offered():
            streams = [nothing.fileno(), out, err]
            return warm.Started(list(words), cwd, streams, dict(os.environ)).wait(240)
        command = [sys.executable, "-m", "rigd", *words]
        return subprocess.run(command, cwd=cwd, stdin=nothing, stdout=out, stderr=err,
                              check=False).returncode  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "short.yaml").write_text(SHORT)
    return tmp_path


@pytest.mark.parametrize(
    ("form", "lost"),
    [("virtual", "pipe"), ("virtual", "disk"), ("virtual", "terminal"), ("paced", "terminal"),
     ("real time", "disk"), ("json", "pipe"), ("quiet", "disk"), ("jog", "terminal")],
)  # fmt: skip
def test_run_is_played_without_a_screen(folder: Path, form: str, lost: str) -> None:
    with LOST[lost]() as screen:
        code = ended(FORMS[form], folder, screen, screen)
    (path,) = (folder / "runs").glob("*.mcap")
    info = Recording.open(path).info
    # At a pace, a loaded machine may miss so many cycles that the run does not count as complete.
    assert (code, info.state) in {(0, "complete"), (6, "incomplete")}
    assert info.trials_done == 1


def test_calibration_is_measured_without_a_screen(folder: Path) -> None:
    """It is recorded; nobody can accept the values, so they are not kept."""
    words = ("run", "calibrate_scale", "--rig", "angle-1")
    with full_disk() as screen:
        assert ended(words, folder, screen, screen) == 0
    (path,) = (folder / "runs").glob("*.mcap")
    assert Recording.open(path).info.state == "complete"


def test_failed_run_keeps_its_exit_code(folder: Path) -> None:
    (folder / "short.yaml").write_text(
        SHORT.replace("for: 0.2 s", "until: carriage.position > 1 m, timeout: 0.1 s")
    )
    with full_disk() as screen:
        assert ended(RUN, folder, screen, screen) == 6


def test_terminal_closed_at_the_beginning_stops_with_5(folder: Path) -> None:
    (folder / "short.yaml").write_text(SHORT.replace("for: 0.2 s", "for: 600 s"))
    terminal = Terminal.open([*RUN, "--pace", "1"], folder)
    terminal.expect("recording to")
    os.close(terminal.master)
    terminal.process.send_signal(signal.SIGHUP)  # as the kernel does, if it is the session's own
    try:
        assert terminal.process.wait(240) == 5
    finally:
        terminal.process.kill()
    (path,) = (folder / "runs").glob("*.mcap")
    info = Recording.open(path).info
    assert info.state == "stopped"
    assert info.reason.startswith("stopped by SIGHUP (the terminal is gone)")


@pytest.mark.parametrize("words", [("schema", "rig"), ("drivers",), ("check", "lugre-1")])
def test_full_output_is_named_and_no_bug(folder: Path, words: tuple[str, ...]) -> None:
    told = folder / "told.txt"
    with full_disk() as screen, told.open("wb") as err:
        assert ended(words, folder, screen, err.fileno()) == 7
    assert told.read_text() == (
        "rigd: standard output cannot be written: No space left on device\n"
    )


@pytest.mark.parametrize("closed", ["1", "2"])
def test_closed_stream_is_no_error(folder: Path, closed: str) -> None:
    rest = {"1": "2>told.txt", "2": ">told.txt"}[closed]
    command = f"{sys.executable} -m rigd check lugre-1 {closed}>&- {rest}"
    done = subprocess.run(command, shell=True, cwd=folder, check=False)
    assert done.returncode == 0
    told = (folder / "told.txt").read_text()
    assert told.startswith("lugre-1: rig lugre-1") if closed == "2" else told == ""


def test_error_without_a_screen_keeps_its_code(folder: Path) -> None:
    with full_disk() as screen:
        assert ended(("check", "absent.yaml"), folder, screen, screen) == 2
    assert rigd("check", "absent.yaml", cwd=folder).code == 2
