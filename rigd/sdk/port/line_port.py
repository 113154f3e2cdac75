"""Receives lines from a serial or TCP port, asks questions and awaits answers, on an event loop."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Final, TypeVar

from rigd.model.errors import DeviceError
from rigd.sdk.port.byte_port import BytePort
from rigd.sdk.port.config import PortConfig
from rigd.sdk.port.lines import MAX_LINE, LineBuffer
from rigd.sdk.port.questions import LATE_S, Heard, Questions

T = TypeVar("T")

#: Lines kept for a reader that does not come; a scale sends at most 92 a second.
_MAX_LINES: Final = 256


class LinePort:
    """A port that is read when bytes arrive, never blocking; for one task at a time.

    Args:
        config: port, baud rate, parity, bits.
        max_line: longest line kept, in bytes.
        self_checking: a line of this protocol shows by itself that characters of it are missing,
            as one with fixed widths does. Then NUL bytes are dropped, and the rest of a line that
            was given up is not waited for.
        late_s: how long an answer that did not come in time is waited for before the next
            question, in s. Replies have no number, so it would be taken for the answer to that.
        min_interval_s: what must lie between two questions, in s.

    """

    def __init__(
        self,
        config: PortConfig,
        *,
        max_line: int = MAX_LINE,
        self_checking: bool = False,
        late_s: float = LATE_S,
        min_interval_s: float = 0.0,
    ) -> None:
        self.path = config.port
        self._bytes = BytePort(config)
        self._buffer = LineBuffer(max_line, drop_nul=self_checking)
        self._self_checking = self_checking
        self._late_s = late_s
        self._questions = Questions(late_s)
        self._min_interval_s = min_interval_s
        self._not_before = 0.0  # when the next question may be sent, in s of the loop
        self._asked_at = 0  # bytes that had come when the last question was sent
        self._lines: deque[bytes] = deque(maxlen=_MAX_LINES)
        self._arrived = asyncio.Event()
        self._reading: int | None = None  # the descriptor with our reader
        #: Bytes that arrived since :meth:`open`, readable or not.
        self.received = 0
        #: The last line that :meth:`ask` passed over, and that was no echo; None if there was none.
        self.unusual: bytes | None = None

    @property
    def late(self) -> int:
        """Answers that came after :meth:`ask` had given them up, since :meth:`open`."""
        return self._questions.late

    @property
    def is_doubtful(self) -> bool:
        """Whether :meth:`ask` will send its question twice, as an earlier answer may still come.

        Before one that is not to be repeated, such as an action or a question for an entry of a
        queue, ask another.
        """
        return self._questions.is_doubtful

    @property
    def overlong(self) -> int:
        """Lines thrown away because they were too long."""
        return self._buffer.overlong

    async def open(self, *, again: bool = False) -> None:
        """Open the port and begin to read; ``again``: at the address that it had.

        Raises:
            LinkError: there is no such port, it is not ours to open, or open already.

        """
        await self._bytes.open_on_loop(again=again)
        self.received = 0
        self.unusual = None
        self._not_before = 0.0
        self._questions = Questions(self._late_s)
        self.flush()
        self._reading = self._bytes.fileno()
        asyncio.get_running_loop().add_reader(self._reading, self._on_bytes)

    def close(self) -> None:
        """Close the port; closing twice is silent."""
        self._stop_reading()
        self._bytes.close()

    def flush(self) -> None:
        """Discard the lines that have arrived, and the one that has begun."""
        self._lines.clear()
        self._buffer.clear()

    def skip(self) -> None:
        """Discard what has arrived, and what comes up to the next end of a line.

        For a device that sends by itself: the begin of its line was not seen.
        """
        self._lines.clear()
        self._buffer.skip()

    def send(self, command: bytes) -> None:
        """Send ``command``.

        Raises:
            DeviceError: the port is gone.
            LinkError: it is not open, or takes no bytes.

        """
        self._bytes.send(command)

    async def line(self, timeout_s: float) -> bytes | None:
        """Return the next line, or None if none is complete within ``timeout_s``.

        Raises:
            DeviceError: the port is gone.
            LinkError: it is not open.

        """
        if not await self._has_line(timeout_s):
            return None
        return self._lines.popleft()

    async def question(self, question: bytes) -> None:
        """Send ``question`` once no earlier answer is due any more; what came before is discarded.

        For answers of several lines, which the caller then takes with :meth:`line`. It raises what
        :meth:`line` does.
        """
        loop = asyncio.get_running_loop()
        await asyncio.sleep(max(0.0, self._not_before - loop.time()))
        while (left := self._questions.left(loop.time())) > 0:
            await self._has_line(left)
            self._pass_lines(loop.time())
        self._pass_lines(loop.time())
        self.flush()
        self._asked_at = self.received
        self.send(question)
        self._not_before = loop.time() + self._min_interval_s

    async def ask(
        self,
        question: bytes,
        take: Callable[[bytes], T | None],
        timeout_s: float,
        *,
        once: bool = False,
    ) -> T | None:
        """Send ``question`` and return what ``take`` makes of its answer; None if it does not come.

        Lines of which ``take`` makes None are passed over: an echo, or a damaged line. An answer
        that may belong to an earlier question is discarded, and the question sent once more; not
        one to be sent ``once``, since it makes the device act.

        Raises:
            DeviceError: the port is gone.
            LinkError: it is not open, or takes no bytes.

        """
        for _ in range(1 if once else 2):
            await self.question(question)
            loop = asyncio.get_running_loop()
            deadline = loop.time() + timeout_s
            self._questions.asked(loop.time(), timeout_s)
            answer, heard = None, Heard.ANSWER
            try:
                answer = await self._answer(question, take, deadline)
                if answer is not None:
                    heard = self._questions.answered(loop.time())
            finally:  # also when cancelled: the answer may come before the next question
                owed = self.received - self._asked_at <= len(question)  # at most the echo
                owed |= self._buffer.begun and not self._self_checking
                self._questions.give_up(loop.time(), owed=owed)
            if heard is Heard.ANSWER:
                return answer
        return None

    async def _answer(
        self, question: bytes, take: Callable[[bytes], T | None], deadline: float
    ) -> T | None:
        loop = asyncio.get_running_loop()
        while (left := deadline - loop.time()) > 0:
            line = await self.line(left)
            if line is None:
                break
            answer = take(line)
            if answer is not None:
                return answer
            if line != question.rstrip():
                self.unusual = line
        return None

    async def quiet(self, quiet_s: float, timeout_s: float) -> bool:
        """Throw away what arrives until nothing has for ``quiet_s``; False at ``timeout_s``."""
        loop = asyncio.get_running_loop()
        deadline = loop.time() + timeout_s
        while loop.time() < deadline:
            before = self.received
            await self._has_line(quiet_s)
            self.flush()
            if self.received == before:
                return True
        return False

    async def _has_line(self, timeout_s: float) -> bool:
        self._bytes.fileno()  # raises if the port is gone
        if not self._lines:
            self._arrived.clear()
            try:
                async with asyncio.timeout(timeout_s):  # wait_for() may swallow a cancel
                    await self._arrived.wait()
            except TimeoutError:  # a line may have come at the same time, as a stall ended
                return bool(self._lines)
            self._bytes.fileno()
        return True

    def _pass_lines(self, now_s: float) -> None:
        while self._lines:
            self._lines.popleft()
            self._questions.passed(now_s)

    def _on_bytes(self) -> None:
        try:
            data = self._bytes.receive()
        except DeviceError:  # unplugged: the reader would be called for ever
            self._stop_reading()
            self._arrived.set()
            return
        self.received += len(data)
        self._lines.extend(self._buffer.feed(data))
        if self._lines:
            self._arrived.set()

    def _stop_reading(self) -> None:
        if self._reading is not None:
            asyncio.get_running_loop().remove_reader(self._reading)
            self._reading = None
