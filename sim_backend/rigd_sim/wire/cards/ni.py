"""Simulates an NI card behind NI's gRPC Device Server, for the unmodified ``nidaqmx`` package."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import partial
from typing import Any, ClassVar, Final

from rigd_sim.wire.cards.ni_card import INPUTS, Faults, Following, Sampling
from rigd_sim.wire.cards.ni_grpc import GrpcServer
from rigd_sim.wire.cards.ni_lines import Lines
from rigd_sim.wire.cards.ni_server import PRODUCT, DeviceServer
from rigd_sim.wire.part import Part, State

#: The card converts what is due this often, in s.
STEP_S: Final = 0.002
#: While no task runs, it checks for one this often, in s.
IDLE_S: Final = 0.02


class SimNi(Part):
    """One card of eight analogue inputs on a device server of its own.

    Args:
        name: the rig's device.
        volts: what is at each physical channel, such as ``{"ai0": ...}``; others are open.
        address: host:port to serve at; port 0 takes a free one.
        device: name of the card in NI MAX.
        drift_ppm: by how much its crystal runs fast.
        noise_v: standard deviation of what the converter adds, in V.
        serial: its serial number.
        seed: of the noise.
        lines: its digital lines and what hangs on them; without it, nothing does.
        sample: samples its inputs, in place of following ``volts`` with noise.
    """

    faults: ClassVar[Mapping[str, str]] = {
        "overrun": "the buffer of the running task overflows, now",
        "short_block": "every read is given half of what it asks for, as at a time-out",
        "removal": "the card is pulled out",
        "saturation": "an input stands at a rail (channel, side: high or low)",
        "stuck_code": "an input repeats its last code (channel)",
        "open_input": "an input is disconnected and picks up the mains (channel)",
        "drift": "the crystal runs fast by another share (ppm)",
        "stall": "answers to reads and writes are held back (seconds)",
    }

    def __init__(
        self,
        name: str,
        volts: Mapping[str, Callable[[], float]],
        *,
        address: str = "127.0.0.1:0",
        device: str = "Dev1",
        drift_ppm: float = 40.0,
        noise_v: float = 1.5e-3,
        serial: int = 0x01C0FFEE,
        seed: int = 1,
        lines: Lines | None = None,
        sample: Sampling | None = None,
    ) -> None:
        unknown = [volt for volt in volts if volt not in INPUTS]
        if unknown:
            raise ValueError(f"{name} has no input {unknown[0]!r}; it has {', '.join(INPUTS)}")
        self.name = name
        self.port = 0  #: where it serves, once started
        self._address = address
        self._volts = volts
        self._shown = Faults()
        self._lines = Lines({}, {}) if lines is None else lines
        follow = partial(Following, volts=volts, noise_v=noise_v, seed=seed)
        self._card = DeviceServer(
            device, serial, volts, sample or follow, self._lines, self._shown, drift_ppm=drift_ppm
        )
        self._server = GrpcServer(name, address)
        self._pump: asyncio.Task[None] | None = None

    async def start(self) -> str:
        """Serve at the address; see :meth:`Part.start`.

        Raises:
            MissingExtra: ``rigd[ni]``, which has the stubs of NI's server, is not installed.
        """
        self.port = await self._server.start(self._card.calls)
        self._pump = asyncio.create_task(self._run())
        self._pump.add_done_callback(self._ended)
        host = self._address.rpartition(":")[0]
        return (
            f"{self.name}: NI {PRODUCT} {self._card.identity.device} at {host}:{self.port} (gRPC)"
        )

    async def stop(self) -> None:
        """Stop serving; stopping twice is silent."""
        await self._server.stop()
        if self._pump is not None:
            self._pump.cancel()
            await asyncio.gather(self._pump, return_exceptions=True)
            self._pump = None

    def state(self) -> State:
        """Return tasks, samples and the voltages at the inputs."""
        running = self._card.running
        return {
            "tasks": self._card.tasks,
            "running": running is not None,
            "samples": 0 if running is None else running.made,
            "unread": 0 if running is None else running.available,
            "removed": self._shown.removal,
            **{f"{channel}_v": volts() for channel, volts in self._volts.items()},
        }

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault of :attr:`faults`; see :meth:`Part.inject`."""
        shown = self._shown
        match fault, options:
            case "overrun", {**rest} if not rest:
                if self._card.running is not None:
                    self._card.running.overrun = True
            case "short_block" | "removal", {**rest} if not rest:
                setattr(shown, fault, True)
                if fault == "removal":
                    self._lines.release()  # it has no power any more
            case "saturation", {"channel": str(channel), **rest} if not rest.keys() - {"side"}:
                sides = {"high": 1.0, "low": -1.0}
                side = rest.get("side", "high")
                if side not in sides:
                    raise ValueError(f"side of saturation is {side!r}, must be high or low")
                shown.saturation[self._input(channel)] = sides[side]
            case "stuck_code", {"channel": str(channel), **rest} if not rest:
                shown.stuck_code.add(self._input(channel))
            case "open_input", {"channel": str(channel), **rest} if not rest:
                shown.open_input.add(self._input(channel))
            case "drift", {"ppm": int() | float() as ppm, **rest} if not rest:
                shown.drift = float(ppm)
            case "stall", {"seconds": int() | float() as seconds, **rest} if not rest:
                shown.stall = float(seconds)
            case _:
                known = "; ".join(f"{name}: {doc}" for name, doc in self.faults.items())
                given = ", ".join(f"{key}={value!r}" for key, value in options.items())
                raise ValueError(f"{self.name} has no fault {fault}({given}); it knows {known}")

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all; what an overrun has lost stays lost."""
        if fault is not None and fault not in self.faults:
            raise ValueError(f"{self.name} has no fault {fault!r}; it knows {list(self.faults)}")
        for field in fields(Faults):
            if fault in (None, field.name):
                setattr(self._shown, field.name, getattr(Faults(), field.name))

    def _input(self, channel: str) -> str:
        if channel not in INPUTS:
            raise ValueError(f"{self.name} has no input {channel!r}; it has {', '.join(INPUTS)}")
        return channel

    def _ended(self, pump: asyncio.Task[None]) -> None:
        if not pump.cancelled() and (error := pump.exception()) is not None:
            context = {"message": f"{self.name} failed", "exception": error}
            asyncio.get_running_loop().call_exception_handler(context)

    async def _run(self) -> None:
        while True:
            await asyncio.sleep(STEP_S if self._card.running else IDLE_S)
            await self._card.advance()
