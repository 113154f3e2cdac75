"""Starts the process of an instrument, asks it without blocking the event loop, and ends it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import subprocess
import tempfile
import threading
from typing import IO, Any, Final

from rigd.model.machine.other_process import how_ended
from rigd.sdk import DeviceError, LinkError
from rigd_drivers.instruments.pymeasure_bridge.checking import PYTHON
from rigd_drivers.instruments.pymeasure_bridge.helper import GRACE_S

#: Longest time for the imports and the opening, in s.
OPEN_S: Final = 15.0
#: So long the driver waits, in s, until the process has ended; then the process goes on alone.
_END_S: Final = 2.0
#: A process that was killed is waited for so long, in s.
_DEAD_S: Final = 0.5
_LOOK_S: Final = 0.01
#: It stood still as this computer did: so long it may still answer then, in s.
_LATE_S: Final = 0.2
_HELPER: Final = "rigd_drivers.instruments.pymeasure_bridge.helper"


class NoAnswer(LinkError):
    """The instrument did not answer in time."""


class Gone(LinkError):
    """The process of the instrument has ended, or hangs and was killed."""


class Process:
    """The process of one instrument; one request at a time.

    Args:
        job: what the process must know; see
            :class:`~rigd_drivers.instruments.pymeasure_bridge.helper.Session`.
        where: the instrument, for messages.

    """

    def __init__(self, job: dict[str, Any], where: str) -> None:
        self._job, self._where = job, where
        self._child: subprocess.Popen[bytes] | None = None
        self._reader: asyncio.StreamReader | None = None
        self._writer: asyncio.StreamWriter | None = None
        self._words: IO[bytes] | None = None
        self._asked = 0

    async def start(self) -> None:
        """Start the process; it opens nothing yet.

        Raises:
            LinkError: it cannot be started.
        """
        ours, theirs = socket.socketpair()
        self._words = tempfile.TemporaryFile()  # noqa: SIM115 - closed by `kill`
        with theirs:
            fd = theirs.fileno()
            try:
                self._child = subprocess.Popen(
                    [*PYTHON, _HELPER, str(fd)], pass_fds=(fd,), start_new_session=True,
                    stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=self._words,
                )  # fmt: skip
            except OSError as error:
                ours.close()
                raise LinkError(f"the process of {self._where} cannot be started: {error}") from (
                    error
                )
        try:
            self._reader, self._writer = await asyncio.open_unix_connection(sock=ours)
        except BaseException:
            ours.close()
            raise
        self._writer.write(json.dumps(self._job).encode() + b"\n")

    async def ask(self, limit_s: float, **request: Any) -> Any:
        """Return the value with which the process answers; requests are done in order.

        Raises:
            NoAnswer: the instrument does not answer.
            LinkError: its connection is lost.
            DeviceError: PyMeasure or the instrument refuses; the text is theirs.
            Gone: the process has ended, or has not answered within ``limit_s`` and was killed.
        """
        if self._writer is None or self._reader is None:
            raise Gone(f"the process of {self._where} does not run")
        self._asked += 1
        with contextlib.suppress(OSError):  # then there is no answer
            self._writer.write(json.dumps({"id": self._asked, **request}).encode() + b"\n")
        answer = await self._answer(self._reader, limit_s)
        answer = answer or await self._answer(self._reader, _LATE_S)
        if answer is None:
            self.kill()
            raise Gone(
                f"{self._where}: PyMeasure did not return within {limit_s:g} s",
                hint="check that it is on, its cable and its settings",
            )
        match answer.get("kind"):
            case None:
                return answer["value"]
            case "silent":
                raise NoAnswer(answer["text"])
            case "lost":
                raise LinkError(answer["text"])
        raise DeviceError(answer["text"])

    async def _answer(self, reader: asyncio.StreamReader, limit_s: float) -> dict[str, Any] | None:
        """Return the answer to the last request; None if there is none within ``limit_s``."""
        try:
            async with asyncio.timeout(limit_s):
                while line := await reader.readline():
                    answer: dict[str, Any] = json.loads(line)
                    if answer["id"] == self._asked:  # those to what was cancelled come before
                        return answer
        except TimeoutError:
            return None
        except OSError:
            pass
        raise self._death()

    async def end(self, limit_s: float = _END_S) -> None:
        """Close the connection, and wait until the process has made safe and closed the instrument.

        A process that takes longer than the driver may wait is not disturbed: it may be making the
        instrument safe. It ends by itself, or is killed if its own time is over.
        """
        child = self._forget()
        if child is None:
            return
        until_s = asyncio.get_running_loop().time() + limit_s
        try:
            while child.poll() is None and asyncio.get_running_loop().time() < until_s:
                await asyncio.sleep(_LOOK_S)
        finally:
            _reap(child, GRACE_S + _DEAD_S)

    def kill(self) -> None:
        """End the process at once, and forget it."""
        child = self._forget()
        if child is not None:
            child.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(_DEAD_S)
            _reap(child, _DEAD_S)

    def _forget(self) -> subprocess.Popen[bytes] | None:
        """Close the connection, and return the process."""
        child, self._child = self._child, None
        writer, self._writer, self._reader = self._writer, None, None
        if writer is not None:
            writer.close()
        if self._words is not None:
            self._words.close()
            self._words = None
        return child

    def _death(self) -> Gone:
        how, words = "closed its connection", ""
        if self._child is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                how = how_ended(self._child.wait(_DEAD_S))
        if self._words is not None:
            self._words.seek(0)
            words = (self._words.read().decode("utf-8", "replace").strip().splitlines() or [""])[-1]
        self.kill()
        return Gone(f"{self._where}: its process {how}" + (f": {words}" if words else ""))


def _reap(child: subprocess.Popen[bytes], limit_s: float) -> None:
    """Wait aside until ``child`` has ended; kill it after ``limit_s``."""

    def wait() -> None:
        try:
            child.wait(limit_s)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()

    if child.poll() is None:
        threading.Thread(target=wait, name="reap", daemon=True).start()
