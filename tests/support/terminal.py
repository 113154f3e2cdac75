"""A command on a terminal of its own, with a person who reads and types."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self


@dataclass
class Terminal:
    """A command on a pty of its own, in ``folder``."""

    process: subprocess.Popen[bytes]
    master: int
    folder: Path
    seen: str = ""

    @classmethod
    def open(cls, arguments: Sequence[str], folder: Path) -> Self:
        """Start ``rigd`` with ``arguments`` in ``folder``."""
        master, slave = pty.openpty()
        process = subprocess.Popen(
            [sys.executable, "-m", "rigd", *arguments],
            cwd=folder, stdin=slave, stdout=slave, stderr=slave, start_new_session=True,
        )  # fmt: skip
        os.close(slave)
        return cls(process, master, folder)

    def expect(self, text: str) -> None:
        """Read until the screen shows ``text`` (each only once)."""
        while text not in self.seen:
            try:
                piece = os.read(self.master, 4096)
            except OSError:  # Linux reports the end of a pty so
                piece = b""
            if not piece:
                raise AssertionError(f"never showed {text!r}, only: {self.seen}")
            self.seen += piece.decode(errors="replace")
        self.seen = self.seen.partition(text)[2]

    def type(self, line: str) -> None:
        """Type ``line`` and press return."""
        os.write(self.master, f"{line}\n".encode())

    def end(self) -> int:
        """Wait for its end and return its exit code."""
        try:
            while os.read(self.master, 4096):
                pass
        except OSError:
            pass
        return self.process.wait(timeout=60)

    def close(self) -> None:
        """End it, whatever it does."""
        self.process.kill()
        self.process.wait()
        os.close(self.master)
