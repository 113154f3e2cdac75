"""Starts a child process of this process, watches it and ends it.

``python -m rigd.engine.system.child PARENT COMMAND...`` runs COMMAND so that COMMAND ends with the
process PARENT (a process id). If the parent is killed, the parent can no longer end its children.
The kernel then sends SIGTERM to COMMAND.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Final

from rigd.engine.system.realtime import PREFERRED, as_program, preferring, weigh_session
from rigd.model.machine.other_process import child_ending, how_ended
from rigd.model.machine.parent import end_with

#: Bytes at the end of its log in which the last printed line of a process is searched.
_LAST_WORDS: Final = 500


class Child:
    """Starts and ends a process, in a session of its own so that Ctrl-C does not reach it.

    Args:
        command: the command; :func:`module` returns the command of a module of rigd.
        log: file to which the output is appended; None: the output of this process.
        fds: descriptors that it inherits; negative numbers are left out.
        tied: whether it ends with this process, however this process ends.
        stdin: whether it reads the input of :meth:`wake` or :meth:`talk`; else it has no input.
        output: whether :meth:`talk` returns its output.
        preferred: whether it gets more time than ordinary programs: what a run waits for.
        environment: variables added to the environment of this process.

    Raises:
        OSError: it cannot be started.
    """

    def __init__(
        self,
        command: Sequence[str],
        *,
        log: Path | None = None,
        fds: Sequence[int] = (),
        tied: bool = False,
        stdin: bool = False,
        output: bool = False,
        preferred: bool = False,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self._log, self._log_began = log, 0
        with ExitStack() as stack:
            printed = subprocess.PIPE if output else None
            if log is not None:
                file = stack.enter_context(log.open("ab"))
                self._log_began, printed = file.tell(), file.fileno()
            stack.enter_context(as_program())
            if preferred:
                stack.enter_context(preferring())
            self._process = subprocess.Popen(
                [*module(__name__, str(os.getpid())), *command] if tied else command,
                stdin=subprocess.PIPE if stdin else subprocess.DEVNULL,
                stdout=printed,
                stderr=printed,
                pass_fds=[fd for fd in fds if fd >= 0],
                env={**os.environ, **(environment or {})},
                start_new_session=True,
            )
        if preferred:
            weigh_session(self.pid, PREFERRED)

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def code(self) -> int | None:
        """Its exit code, negative for the signal that ended it; None while it runs."""
        return self._process.poll()

    @property
    def ended(self) -> str:
        """How it ended, in words that follow its name, or "" while it runs."""
        return "" if self.code is None else how_ended(self.code)

    def fate(self, timeout_s: float) -> str:
        """Return :attr:`ended`, and wait at most ``timeout_s`` if it is just being killed.

        The kernel then may take a while to clear it away: see
        :mod:`rigd.model.machine.other_process`.
        """
        if self.code is None and child_ending(self.pid) and not self.wait(timeout_s):
            return "ends, and the kernel still holds it"
        return self.ended

    def wait(self, timeout_s: float | None) -> bool:
        """Wait until it has ended, forever if ``timeout_s`` is None; return whether it has."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout_s)
            return True
        return False

    def fence(self, timeout_s: float | None) -> bool:
        """Kill it, whatever it does; return whether it has ended within ``timeout_s``.

        A process that the kernel holds (a call into a device that hangs) may not end, but after the
        kill it executes no more of its own code. Fencing twice is silent.
        """
        self._process.kill()
        return self.leave(timeout_s)

    def leave(self, timeout_s: float | None) -> bool:
        """Wait as :meth:`wait` does; whatever it returns, no defunct process is left in the end."""
        if self.wait(timeout_s):
            return True
        threading.Thread(target=self._process.wait, name="reaper", daemon=True).start()
        return False

    def terminate(self) -> None:
        """Request it to end (SIGTERM)."""
        self._process.terminate()

    def wake(self) -> bool:
        """Send a line to a process that waits for it; return whether the process could read it."""
        if self.code is not None or self._process.stdin is None:
            return False
        try:
            self._process.stdin.write(b"\n")
            self._process.stdin.flush()
        except BrokenPipeError:  # it has just ended
            return False
        finally:
            self.close_stdin()
        return True

    def close_stdin(self) -> None:
        """Close its input; a process that has ended reads no more anyway."""
        if self._process.stdin is not None:
            with suppress(BrokenPipeError):
                self._process.stdin.close()

    def talk(self, given: str | None, timeout_s: float) -> tuple[str, str] | None:
        """Send its whole input; return its output and error output after it has ended.

        None if it has not ended within ``timeout_s``: call it again, with None for ``given``.
        """
        try:
            read = None if given is None else given.encode()
            out, errors = self._process.communicate(read, timeout=timeout_s)
        except subprocess.TimeoutExpired:
            return None
        return out.decode(), errors.decode(errors="replace")

    def last_words(self) -> str:
        """Return the last line that it has printed to its log, or ""."""
        if self._log is None:
            return ""
        with self._log.open("rb") as file:
            end = file.seek(0, os.SEEK_END)
            file.seek(max(self._log_began, end - _LAST_WORDS))
            lines = file.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else ""


def module(name: str, *arguments: str) -> list[str]:
    """Return the command that runs a module of rigd in this interpreter."""
    # Without -P the folder in which it starts could provide modules of its own.
    return [sys.executable, "-P", "-m", name, *arguments]


def _become() -> None:
    """Execute the command, unless the parent has ended already."""
    parent, *command = sys.argv[1:]
    try:
        lives = end_with(int(parent), signal.SIGTERM)
    except OSError as error:
        sys.exit(f"cannot be tied to process {parent}: {error.strerror}")
    if lives:
        os.execvp(command[0], command)


if __name__ == "__main__":
    _become()
