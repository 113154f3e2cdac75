"""Simulates a sensor that sends messages of a DBC file by itself on a CAN bus."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final

from rigd.model.machine.extras import require
from rigd_sim.wire.can.hub import CanHub, Port
from rigd_sim.wire.part import Part, State

_EXTENDED: Final = 0x8000_0000
#: An identifier that no DBC of a test has.
_FOREIGN: Final = 0x7E5


class SimDbcSensor(Part):
    """A sensor that sends one message at a rate.

    Args:
        name: the part.
        hub: its bus.
        dbc: the file.
        message: name of the message.
        values: of its signals, in the units of the DBC.
        period_s: time between two frames.
    """

    faults: ClassVar[Mapping[str, str]] = {
        "silent": "it sends nothing",
        "short": "its frames have a byte less than the DBC has",
        "foreign": "it sends frames of other identifiers in between",
        "value": "a signal has another value (signal, value)",
    }

    def __init__(
        self,
        name: str,
        hub: CanHub,
        dbc: Path,
        message: str,
        values: Mapping[str, float],
        *,
        period_s: float = 0.01,
    ) -> None:
        require("dbc", "a simulated sensor of a DBC")
        import cantools

        self.name = name
        self._hub = hub
        database: Any = cantools.database.load_file(dbc, database_format="dbc")
        self._message = database.get_message_by_name(message)
        self._values = dict(values)
        self._period_s = period_s
        self._shown: set[str] = set()
        self._changed: dict[str, float] = {}
        self._sent = 0
        self._port: Port | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._encoded()  # values that the message cannot carry raise here

    async def start(self) -> str:
        """Begin to send; see :meth:`Part.start`."""
        self._port = self._hub.attach(lambda *_: None)
        self._tick()
        return f"{self.name}: message {self._message.name} on {self._hub.name}"

    async def stop(self) -> None:
        """Leave the bus; stopping twice is silent."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._port is not None:
            self._port.detach()
            self._port = None

    def state(self) -> State:
        """Return how many frames it has sent, and the values."""
        return {"sent": self._sent, **self._values, **self._changed}

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault of :attr:`faults`; see :meth:`Part.inject`."""
        match fault, options:
            case "value", {"signal": str(signal), "value": int() | float() as value, **rest} if (
                not rest and signal in self._values
            ):
                self._changed[signal] = float(value)
            case (("silent" | "short" | "foreign"), {**rest}) if not rest:
                self._shown.add(fault)
            case _:
                known = "; ".join(f"{name}: {doc}" for name, doc in self.faults.items())
                raise ValueError(f"{self.name} has no fault {fault}({options}); it knows {known}")

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
        if fault in (None, "value"):
            self._changed.clear()
        self._shown = set() if fault is None else self._shown - {fault}

    def _encoded(self) -> bytes:
        data: bytes = self._message.encode({**self._values, **self._changed}, strict=False)
        return data

    def _tick(self) -> None:
        self._timer = asyncio.get_running_loop().call_later(self._period_s, self._tick)
        port = self._port
        if port is None or "silent" in self._shown:
            return
        data = self._encoded()
        flag = _EXTENDED if self._message.is_extended_frame else 0
        port.send(self._message.frame_id | flag, data[:-1] if "short" in self._shown else data)
        self._sent += 1
        if "foreign" in self._shown:
            port.send(_FOREIGN, data)
