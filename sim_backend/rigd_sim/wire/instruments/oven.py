"""Simulates an oven that takes its temperature by SCPI, on a serial port and over TCP.

Commands: `SOUR:TEMP number`, `SOUR:TEMP?`, `MEAS:TEMP?`, `MEAS:POW?`, `OUTP ON|OFF`, `OUTP?`,
`*IDN?`, `*CLS`, `SYST:ERR?`, in degC and %. Errors stand in a queue (SCPI-1999, volume 1, 21.8). It
has no watchdog. Inside is one heated mass that loses heat to the room, and a PI controller.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import time
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar, Final

from rigd_sim.wire.part import State
from rigd_sim.wire.serial_part import MAX_COMMAND, PORT_FAULTS, WIRE_FAULTS, SerialPart

_SET: Final = re.compile(r"SOUR(?:CE)?:TEMP(?:ERATURE)? (?P<number>\S+)")
_NUMBER: Final = re.compile(r"[-+]?\d+(?:\.\d*)?(?:E[-+]?\d+)?")
#: Entries of its error queue.
_QUEUE: Final = 10
#: Full power heats the mass so much above the room in the end, in K.
_HOTTEST_RISE: Final = 300.0
#: Longest step of the integration in s of the oven, as a part of its time constant.
_STEP: Final = 0.01


class SimOven(SerialPart):
    """An oven on a pty and, with ``port``, on a TCP port of this machine.

    Args:
        name: its name.
        path: of the pty.
        port: TCP port on loopback; 0 for any free one, None for no TCP.
        lowest: lowest setpoint that it takes, in degC.
        highest: highest setpoint that it takes, in degC.
        ambient: temperature of the room, where it begins, in degC.
        time_constant_s: of the heated mass.
        identity: its answer to *IDN?.
        baud: of the pty.
        seed: of the faults of the wire.

    """

    faults: ClassVar[Mapping[str, str]] = {
        **WIRE_FAULTS,
        "stuck": "answers, and goes on as it was: it obeys no command",
        "locked": "its heater is not switched on, and goes off if it was on",
        "setpoint_ignored": "keeps the setpoint that it has",
        "tripped": "its protection switches the heater off, once, with an error in the queue",
        "broken_wire": "its thermometer gives 9.9E37, which means infinity",
        **PORT_FAULTS,
    }

    def __init__(
        self,
        name: str,
        path: Path,
        *,
        port: int | None = None,
        lowest: float = 0.0,
        highest: float = 200.0,
        ambient: float = 21.0,
        time_constant_s: float = 60.0,
        identity: str = "rigd,simulated oven,1,1.0",
        baud: int = 9600,
        seed: int = 0,
    ) -> None:
        super().__init__(name, path, baud=baud, seed=seed, end=b"\n")
        self._port = port
        self._bounds = (lowest, highest)
        self._ambient = self._setpoint = self._temperature = ambient
        self._time_constant_s = time_constant_s
        self._identity = identity
        self._on = False
        self._integral = self._power = 0.0  # parts of full power
        self._at_s = time.monotonic()
        self._queue: deque[str] = deque()
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.StreamWriter] = set()
        self._safe_since_ns = time.monotonic_ns()
        self.sent = 0  #: answers, each counted before it is sent

    @property
    def port(self) -> int:
        """The TCP port, once it is started; 0 without."""
        return 0 if self._server is None else self._server.sockets[0].getsockname()[1]

    async def start(self) -> str:
        """Open the pty and the TCP port; see :meth:`Part.start`."""
        self.plug_in()
        if self._port is None:
            return f"{self.name}: oven at {self.path}"
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", self._port)
        return f"{self.name}: oven at {self.path} and tcp://127.0.0.1:{self.port}"

    async def stop(self) -> None:
        """Close both ports."""
        if self._server is not None:
            self._server.close()
            self._server = None
        for client in list(self._clients):
            client.close()
        await super().stop()

    def state(self) -> State:
        """Return temperatures in degC, power in %, and since when it is off.

        ``safe_since_ns`` (CLOCK_MONOTONIC) is 0 while the heater is on.
        """
        self._advance()
        return {
            "output": self._on,
            "set_temperature": self._setpoint,
            "temperature": self._temperature,
            "power": 100.0 * self._power,
            "sent": self.sent,
            "plugged_in": self.plugged_in,
            "safe_since_ns": self._safe_since_ns,
            "faults": ", ".join(self._active),
        }

    def show(self, fault: str) -> None:
        """Show a fault of the oven; see :class:`SerialPart`."""
        if fault == "tripped":
            del self._active[fault]
            self._report('101,"Over-temperature protection"')
        if fault in ("tripped", "locked"):
            self._switch(on=False)
        if fault == "unplug":
            for client in list(self._clients):
                client.close()

    def send(self, data: bytes) -> None:
        """Send bytes to the pty, and to every client of the TCP port."""
        super().send(data)
        if "silent" not in self._active and self.plugged_in:
            for client in self._clients:
                client.write(data)

    def on_command(self, command: bytes) -> None:
        """Obey the commands of a line, and send the answers to its questions in one line."""
        self._advance()
        answers = []
        for item in command.decode("latin-1").split(";"):
            answer = self._obey(item.strip().lstrip(":").upper())
            if answer is not None:
                answers.append(answer)
        if answers:
            self.sent += 1
            self.reply(";".join(answers).encode("latin-1"))

    def _obey(self, item: str) -> str | None:
        match item:
            case "*IDN?":
                return self._identity
            case "*CLS":
                self._queue.clear()
            case "SYST:ERR?" | "SYST:ERR:NEXT?" | "SYSTEM:ERROR?":
                return self._queue.popleft() if self._queue else '0,"No error"'
            case "OUTP?":
                return str(int(self._on))
            case "SOUR:TEMP?":
                return f"{self._setpoint:.2f}"
            case "MEAS:TEMP?":
                broken = self.shown("broken_wire") is not None
                return "9.9E37" if broken else f"{self._temperature:.3f}"
            case "MEAS:POW?":
                return f"{100.0 * self._power:.1f}"
            case "OUTP ON" | "OUTP 1":
                self._switch(on=self.shown("locked") is None)
            case "OUTP OFF" | "OUTP 0":
                self._switch(on=False)
            case _ if (match := _SET.fullmatch(item)) is not None:
                self._take(match["number"])
            case _:
                self._report('-113,"Undefined header"')
        return None

    def _take(self, number: str) -> None:
        if _NUMBER.fullmatch(number) is None:
            self._report('-104,"Data type error"')
        elif not self._bounds[0] <= float(number) <= self._bounds[1]:
            self._report('-222,"Data out of range"')
        elif self.shown("setpoint_ignored") is None and self.shown("stuck") is None:
            self._setpoint = float(number)

    def _report(self, entry: str) -> None:
        if len(self._queue) < _QUEUE:
            self._queue.append(entry)
        else:
            self._queue[-1] = '-350,"Queue overflow"'

    def _switch(self, *, on: bool) -> None:
        if self.shown("stuck") is not None or on == self._on:
            return
        self._on, self._integral = on, 0.0
        self._safe_since_ns = 0 if on else time.monotonic_ns()

    def _advance(self) -> None:
        """Bring the temperature to this moment: tau dT/dt = rise * power - (T - ambient)."""
        now_s = time.monotonic()
        left_s, self._at_s = now_s - self._at_s, now_s
        longest_s = _STEP * self._time_constant_s
        while left_s > 0.0:
            step_s = min(left_s, longest_s)
            left_s -= step_s
            part = step_s / self._time_constant_s
            error = self._setpoint - self._temperature
            if self._on:
                wanted = 0.05 * error + self._integral
                self._power = min(max(wanted, 0.0), 1.0)
                if wanted == self._power:  # the integral stands still at a limit
                    self._integral += 0.05 * error * part * 5.0
            else:
                self._power = 0.0
            above = self._temperature - self._ambient
            self._temperature += (_HOTTEST_RISE * self._power - above) * part

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients.add(writer)
        try:
            while line := await reader.readline():
                command = line.strip(b"\r\n")
                if command and len(command) <= MAX_COMMAND and "silent" not in self._active:
                    self.on_command(command)
        except (ConnectionError, ValueError):
            pass  # the client is gone, or sends no lines
        finally:
            self._clients.discard(writer)
            with contextlib.suppress(ConnectionError):
                writer.close()
