"""A command on a terminal of its own, with a person who reads and types."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import subprocess
import termios
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from support import warm

#: What takes longer has hung.
TIMEOUT_S: Final = 60.0
#: Colours and movements of the cursor (ECMA-48, 5.4): a person sees what they do, not them.
_CONTROL: Final = re.compile(r"\x1b\[[0-?]*[ -/]*[@-~]")


@dataclass
class Terminal:
    """A command on a pty of its own, in ``folder``."""

    process: warm.Started | subprocess.Popen[bytes]
    master: int
    folder: Path
    seen: str = ""

    @classmethod
    def open(
        cls, arguments: Sequence[str], folder: Path, columns: int = 80, early: str = ""
    ) -> Self:
        """Start ``rigd`` with ``arguments`` in ``folder``; ``early`` was typed before it asks."""
        master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        if early:  # a loaded machine takes its time from the key to the terminal: await the echo
            os.write(master, f"{early}\n".encode())
            echo = b""
            while b"\n" not in echo:
                echo += os.read(master, 4096)
        process = warm.start(arguments, folder, slave, stdin=slave)
        os.close(slave)
        return cls(process, master, folder)

    def expect(self, text: str) -> str:
        """Read until the screen shows ``text`` (each only once); return what came before it."""
        with self._ended_in_time():
            while text not in self.seen:
                if not self._read():
                    raise AssertionError(f"never showed {text!r}, only: {self.seen}")
        before, _, self.seen = self.seen.partition(text)
        return before

    def type(self, line: str) -> None:
        """Type ``line`` and press return."""
        os.write(self.master, f"{line}\n".encode())

    def end(self) -> int:
        """Wait for its end and return its exit code."""
        with self._ended_in_time():
            while self._read():
                pass
            return self.process.wait()

    def close(self) -> None:
        """End it in any state."""
        self.process.kill()
        self.process.wait()
        os.close(self.master)

    def _read(self) -> bool:
        """Take what stands on the screen next; False if the command has ended."""
        try:
            piece = os.read(self.master, 4096)
        except OSError:  # Linux reports the end of a pty so
            return False
        # A sequence that is cut in two is whole once the next piece has come.
        self.seen = _CONTROL.sub("", self.seen + piece.decode(errors="replace"))
        return bool(piece)

    @contextmanager
    def _ended_in_time(self) -> Iterator[None]:
        """Kill a command that hangs, so that its screen ends."""
        watchdog = threading.Timer(TIMEOUT_S, self.process.kill)
        watchdog.start()
        try:
            yield
        finally:
            watchdog.cancel()
