"""Drives a device that takes setpoints in lines, as the rig file describes it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import ClassVar, Final, TypeVar

from rigd.sdk import (
    Declaration,
    DeviceError,
    Driver,
    DriverConfig,
    LinkError,
    ProtocolError,
    readable,
)
from rigd.sdk.port import BytePort, Heard, LineBuffer, Questions
from rigd_drivers.instruments.lines.outputs import LineOutputsConfig, clipped
from rigd_drivers.instruments.lines.reader import LineReader, Reading
from rigd_drivers.instruments.lines.tally import LineStatus, Tally
from rigd_drivers.instruments.lines.text import encoded
from rigd_drivers.wait import looks

T = TypeVar("T")

#: Longest time to an answer while the device is opened, and after it was made safe, in s; the last
#: must be below 0.5 s.
OPEN_S: Final = 1.0
CONFIRM_S: Final = 0.4
#: How long a new connection may take as the device is made safe, in s.
ANEW_S: Final = 0.2
#: Bit of the status word: the device has reported that its output is on.
READY: Final = 8


class LineOutputs(Driver[LineOutputsConfig, None]):
    """A device that follows setpoints in lines; safe is what the lines of `safe` make of it.

    It has no watchdog that rigd knows of: if this computer fails, the device goes on. A rig file
    must give a waiver. After a kill of the cycle another process sends `safe` (``rescue``).
    """

    Config: ClassVar[type[DriverConfig]] = LineOutputsConfig
    title: ClassVar[str] = "device that takes setpoints in lines, such as a supply with SCPI"
    unshared: ClassVar[tuple[str, ...]] = ("port",)
    second_link: ClassVar[bool] = True
    reads_when_safe: ClassVar[bool] = True  # questions; a setpoint is sent only once it is armed

    def __init__(self, config: LineOutputsConfig, link: None) -> None:
        super().__init__(config, link)
        self._port = BytePort(config)
        self._is_open = False  # until close(), also if the port is gone
        self._lines = LineBuffer(config.longest)
        self._questions = Questions()
        self._tally = Tally(config)
        self._ask, self._ask_state = encoded(config.ask), encoded(config.state.ask)
        self._asked = b""  # the question that is open
        self._due_s = 0.0  # when the channels are asked again
        self._set_due_s = 0.0  # when setpoints may be sent again
        self._state_due = False  # the state is asked next
        self._wanted: tuple[float, ...] | None = None  # None before arm(), and once it is safe
        self._sent: tuple[bytes, ...] = ()  # lines of the setpoints that were sent last
        self._on: bool | None = None  # as the device reports it
        self._was_ready = False
        self._mute = False  # no answer came to the last question

    @classmethod
    def declare(cls, config: LineOutputsConfig) -> Declaration:
        """Return the channels and setpoints of the rig file.

        Raises:
            ValueError: an answer to `state` could be a line of channels.

        """
        reader = LineReader(config)
        for answer in (config.state.safe, config.state.ready):
            if isinstance(reader.read(answer.encode()), Reading):
                raise ValueError(
                    f"the answer {answer!r} of `state` could be a line of channels: make `pattern` "
                    "narrower, or ask for more in one line"
                )
        return Declaration(
            channels=tuple(item.channel(name) for name, item in config.channels.items()),
            setpoints=config.setpoints(),
            plain_rows=True,
            has_status=True,
            status_bits={
                **{(bit.name or "").lower(): bit.value for bit in LineStatus},
                "ready": READY,
            },
            every_cycle=False,
            silent_s=config.silence_s,
        )

    def open(self) -> None:
        """Open the port, send `start`, and prove that lines are as described; nothing is set.

        Raises:
            LinkError: nothing answers, or the port is open already.
            ProtocolError: the answers are others; names the last one.

        """
        config = self.config
        self._port.open()
        try:
            self._lines.clear()
            self._questions, self._tally = Questions(), Tally(config)
            self._wanted, self._was_ready, self._due_s = None, False, 0.0
            self._mute = False
            for command in config.start:
                self._port.send(encoded(command))
            self.identity = f"lines at {config.port}"
            if config.identify is not None:
                asked = encoded(config.identify)
                line = self._wait(asked, partial(LineReader(config).identity, asked), OPEN_S)
                self.identity = line.decode("latin-1").strip()
            self._on = self._wait(self._ask_state, self._state, OPEN_S)
            self._wait(self._ask, self._tally.take, OPEN_S)
        except BaseException:
            self._port.close()
            raise
        self._is_open = True

    def preflight(self) -> Sequence[str]:
        """Return that the output is on already, if it is."""
        return ["its output is on: switch it off by hand"] if self._on else []

    def arm(self) -> None:
        """Set all setpoints to rest, then send `arm`."""
        self._on = None  # it was on before it was made safe: that says nothing
        self._wanted = self.config.rest()
        self._sent = self._setting(self._wanted)
        self._port.send(b"".join((*self._sent, *map(encoded, self.config.arm))))

    def ready(self) -> bool:
        """Return whether the device has reported that its output is on."""
        return self._wanted is not None and bool(self._on)

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return the newest row, if there is one; send setpoints and the next question.

        Raises:
            DeviceError: the output went off by itself, or the port is gone.

        """
        row = self._heard(time.monotonic())
        self._send_next(time.monotonic())
        if self._was_ready and self._on is False:
            raise DeviceError(
                f"{self._port.where} has switched its output off",
                hint="look for its protection, or another program that commands it",
            )
        self._was_ready |= self.ready()
        return row

    def write(self, setpoints: Sequence[float]) -> None:
        """Take the setpoints, clipped to their ranges; they are sent once in a period.

        Raises:
            DeviceError: one is NaN; those before hold.

        """
        channels = self.declaration.setpoints
        for channel, value in zip(channels, setpoints, strict=True):
            if math.isnan(value):
                raise DeviceError(f"setpoint {channel.name!r} is NaN, expected {channel.unit}")
        if self._wanted is not None:
            self._wanted = tuple(map(clipped, setpoints, channels))

    def make_safe(self) -> None:
        """Send `safe`, at once; over a new connection if the open one is of no use.

        Raises:
            DeviceError: the port is gone again.
            LinkError: it cannot be opened within 0.2 s, or the lines could not be sent.

        """
        self._wanted, self._was_ready = None, False
        if not self._is_open:
            return
        try:
            self._send_safe()
        except (LinkError, DeviceError):
            self._port.close()  # a device may take one connection only
            self._open_anew()
            self._send_safe()

    def confirm_safe(self) -> None:
        """Check that the device shows that it is safe.

        `safe` is sent again over a new connection if the last question has had no answer: a
        connection may be dead and take bytes all the same.

        Raises:
            LinkError: it does not answer, or takes no new connection within 0.2 s.
            DeviceError: it is not safe, or the port is gone.
            ProtocolError: its answers are others.

        """
        if not self._is_open:
            return
        if self._mute and self.config.is_tcp:
            self._port.close()
            self._open_anew()
            self._send_safe()
        self._confirm_safe(owed=self._questions.is_open)

    def _confirm_safe(self, *, owed: bool) -> None:
        """Ask the state; twice if an answer from before `safe` may be on its way (``owed``)."""
        found: list[bool] = []
        within_s = CONFIRM_S / (2 if owed else 1)

        def safe(line: bytes) -> bool | None:
            on = self._state(line)
            found.extend([] if on is None else [on])
            return None if on in (None, True) else on

        try:
            self._discard()
            if owed:  # what comes behind the first answer is of now
                self._wait(self._ask_state, self._state, within_s)
            self._wait(self._ask_state, safe, within_s)
        except (LinkError, ProtocolError):
            if not found:
                raise
            raise DeviceError(
                f"{self._port.where} is not safe after `safe`: it answers "
                f"{self.config.state.ready!r} to {self._ask_state!r}",
                hint="switch it off by hand",
            ) from None

    def rescue(self) -> None:
        """Make the device safe over a new connection; see :class:`Driver`."""
        try:
            self._open_anew()
            self._is_open = True
            self.make_safe()
            self._confirm_safe(owed=True)
        finally:
            self._is_open = False
            self._port.close()

    def close(self) -> None:
        """Send `stop`, if the port is still there, and close it; closing twice is silent."""
        self._is_open = False
        try:
            for command in self.config.stop if self._port.is_open else ():
                self._port.send(encoded(command))
        except (LinkError, DeviceError):
            return  # gone: nothing hears it
        finally:
            self._port.close()

    def _open_anew(self) -> None:
        self._port.open_again(ANEW_S)
        self._mute = False
        self._lines.clear()
        self._questions = Questions()

    def _send_safe(self) -> None:
        self._port.send(b"".join(map(encoded, self.config.safe)))

    def _discard(self) -> None:
        """Throw away what has come: it answers an earlier question."""
        while self._port.receive():
            pass
        self._lines.clear()

    def _setting(self, values: tuple[float, ...]) -> tuple[bytes, ...]:
        items = self.config.outputs.items()
        return tuple(
            item.line(name, value) for (name, item), value in zip(items, values, strict=True)
        )

    def _state(self, line: bytes) -> bool | None:
        """Return whether the output is on; None if the line is no answer to `state`."""
        text, state = line.decode("latin-1").strip(), self.config.state
        return {state.safe.strip(): False, state.ready.strip(): True}.get(text)

    def _send_next(self, now_s: float) -> None:
        """Send setpoints that have changed, and the next question, if they are due.

        While a question is open nothing is sent: a line would break off its answer. Setpoints do
        not wait for an answer that was given up.
        """
        if self._questions.is_open:
            return
        if self._wanted is not None and now_s >= self._set_due_s:
            lines = self._setting(self._wanted)
            pairs = zip(lines, self._sent, strict=True)
            if changed := b"".join(new for new, old in pairs if new != old):
                self._port.send(changed)
                self._sent, self._set_due_s = lines, now_s + self.config.period
        if self._questions.left(now_s):
            return
        if self._state_due:
            self._question(self._ask_state, now_s)
            self._state_due = False
        elif now_s >= self._due_s:
            self._question(self._ask, now_s)
            self._due_s = now_s + self.config.period
            self._state_due = True

    def _question(self, question: bytes, now_s: float) -> None:
        self._port.send(question)
        self._asked = question
        self._questions.asked(now_s, self.config.timeout)

    def _heard(self, now_s: float) -> Sequence[float] | None:
        """Return the row of the last answer, if it has come; a late one is thrown away."""
        row = None
        for line in self._lines.feed(self._port.receive()):
            if line.strip() in (self._ask.strip(), self._ask_state.strip()):
                continue  # an echo
            on = self._state(line)
            reading = self._tally.take(line) if on is None else None
            if on is None and reading is None:
                continue  # counted
            self._mute = False
            of_state = self._asked == self._ask_state
            if self._questions.answered(now_s) is not Heard.ANSWER or of_state is (on is None):
                continue  # late, or to another question
            if reading is None:
                self._on = on
            else:
                *values, status = self._tally.row(reading, self._lines.overlong)
                row = (*values, int(status) | (READY if self.ready() else 0))
        if self._questions.expired(now_s):
            self._questions.give_up(now_s, owed=True)
            self._tally.unanswered()
            self._mute = True
        return row

    def _wait(self, question: bytes, take: Callable[[bytes], T | None], timeout_s: float) -> T:
        """Send ``question`` and wait for its answer; too slow for the cycle."""
        self._port.send(question)
        last = b""
        for left_s in looks(timeout_s):
            readable(self._port.fileno(), left_s)
            for line in self._lines.feed(self._port.receive()):
                answer = take(line)
                if answer is not None:
                    return answer
                last = line if line.strip() != question.strip() else last
        if self._tally.last is not None:
            raise ProtocolError(
                self._tally.wrong(self._port.where, f"for {timeout_s:g} s"),
                hint="compare the line with `pattern` or `columns`",
            )
        if last:
            raise ProtocolError(
                f"{self._port.where} answers {last[:60]!r} to {question!r}",
                hint="compare the answer with `state`, and check the baud rate",
            )
        raise LinkError(
            f"{self._port.where} does not answer {question!r} within {timeout_s:g} s",
            hint="check that the device is on, its cable, its baud rate, and the end of `ask`",
        )
