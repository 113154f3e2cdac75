"""The command line as a user meets it: a process, its output, its exit code."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from support import warm

#: A run that takes longer has hung.
TIMEOUT_S = 240


@dataclass(frozen=True)
class Ended:
    """A command that has ended."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """What it printed, as an object."""
        return json.loads(self.out)


def rigd(*arguments: str | Path, cwd: Path, state: Path | None = None) -> Ended:
    """Run a command to its end; in tests, without importing all again.

    ``state`` is where the rings of its runs stand, if not where they usually do.
    """
    environment = os.environ | ({} if state is None else {"RIGD_STATE": str(state)})
    if warm.offered():
        ended = Ended(
            *warm.run([str(argument) for argument in arguments], cwd, TIMEOUT_S, environment)
        )
        assert "Traceback" not in ended.err, ended.err
        return ended
    done = subprocess.run(
        [sys.executable, "-m", "rigd", *map(str, arguments)],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert "Traceback" not in done.stderr, done.stderr
    return Ended(done.returncode, done.stdout, done.stderr)


@dataclass
class Running:
    """A command that runs; :meth:`wait_for` reads its output as it comes."""

    process: subprocess.Popen[str]
    lines: list[str] = field(default_factory=list)

    def wait_for(self, text: str) -> None:
        """Wait until a line of standard error holds ``text``."""
        watchdog = threading.Timer(TIMEOUT_S, self.process.kill)
        watchdog.start()
        try:
            assert self.process.stderr is not None
            for line in self.process.stderr:
                self.lines.append(line)
                if text in line:
                    return
            ended = self.end()
            raise AssertionError(f"ended without saying {text!r}: {ended.err}{ended.out}")
        finally:
            watchdog.cancel()

    def signal(self, number: signal.Signals) -> None:
        """Send a signal."""
        os.kill(self.process.pid, number)

    def end(self) -> Ended:
        """Wait for its end."""
        out, err = self.process.communicate(timeout=TIMEOUT_S)
        return Ended(self.process.returncode, out, "".join(self.lines) + err)


def start(arguments: Sequence[str | Path], cwd: Path) -> Running:
    """Start a command in a session of its own, as a terminal would."""
    return Running(
        subprocess.Popen(
            [sys.executable, "-m", "rigd", *map(str, arguments)],
            cwd=cwd,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
    )
