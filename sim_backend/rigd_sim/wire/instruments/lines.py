"""Serves devices that send lines of numbers, each on a serial port; their values are data."""

from __future__ import annotations

import asyncio
import random
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self

from annotated_types import Ge, Gt, Le, MinLen
from pydantic import Field, model_validator

from rigd.sdk import In, SimulationConfig, wrong_entry
from rigd_sim.wire.folder import Folder
from rigd_sim.wire.instruments.oven import SimOven
from rigd_sim.wire.instruments.scale import SimScale
from rigd_sim.wire.instruments.supply import SimSupply
from rigd_sim.wire.part import Part, State
from rigd_sim.wire.serial_part import PORT_FAULTS, WIRE_FAULTS, SerialPart
from rigd_sim.wire.service import WireConfig, WireSimulation, World


class SimLines(SerialPart):
    """A device that answers ``ask`` with ``answer``, or sends it every ``interval_s``.

    ``answer`` has the names of the values in braces: ``{force:+.3f} N``; with ``comma`` its
    numbers have a decimal comma. ``identity`` answers ``*IDN?``; any other command has no answer.
    """

    faults: ClassVar[Mapping[str, str]] = {
        **WIRE_FAULTS,
        "comma": "numbers have a decimal comma",
        "short": "the last column is missing",
        "word": "a word stands in place of the first number (word=OL)",
        "endless": "sends without an end of line",
        **PORT_FAULTS,
    }
    fault_options: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        **SerialPart.fault_options,
        "word": {"word": "OL"},
    }

    def __init__(
        self,
        name: str,
        path: Path,
        values: Callable[[], Mapping[str, float]],
        answer: str,
        *,
        ask: str | None = None,
        interval_s: float = 0.1,
        identity: str = "",
        comma: bool = False,
        baud: int = 9600,
        seed: int = 0,
    ) -> None:
        super().__init__(name, path, baud=baud, seed=seed, end=b"\r\n")
        self._comma = comma
        self._values = values
        self._answer = answer
        self._ask = None if ask is None else ask.encode()
        self._interval_s = interval_s
        self._identity = identity
        self._sending: asyncio.TimerHandle | None = None
        self.sent = 0  #: lines
        self.commands: list[bytes] = []  #: those that came and were no question

    async def start(self) -> str:
        """Open the pty; see :meth:`Part.start`."""
        self.plug_in()
        if self._ask is None:
            self._tick()
        return f"{self.name}: lines at {self.path}"

    async def stop(self) -> None:
        """Close the pty."""
        if self._sending is not None:
            self._sending.cancel()
            self._sending = None
        await super().stop()

    def state(self) -> State:
        """What it measures and how much it has sent."""
        return {**self._values(), "sent": self.sent, "plugged_in": self.plugged_in}

    def on_command(self, command: bytes) -> None:
        """Answer the question."""
        if command == self._ask:
            self._send_values()
        elif command == b"*IDN?":
            self.reply(self._identity.encode())
        else:
            self.commands.append(command)

    def line(self) -> bytes:
        """Return a line of this moment, as the faults of the device have it."""
        text = self._answer.format_map(self._values())
        if self._comma or self.shown("comma") is not None:
            text = re.sub(r"(\d)\.(\d)", r"\1,\2", text)
        if self.shown("short") is not None:
            text = re.sub(r"[ ,;\t]+[^ ,;\t]*$", "", text)
        if (options := self.shown("word")) is not None:
            text = re.sub(r"[-+]?\d+\.?\d*", str(options["word"]), text, count=1)
        return text.encode()

    def _send_values(self) -> None:
        self.sent += 1
        if self.shown("endless") is not None:
            self.send(self.line())
        else:
            self.reply(self.line())

    def _tick(self) -> None:
        self._send_values()
        loop = asyncio.get_running_loop()
        self._sending = loop.call_later(self._interval_s, self._tick)


class AnswerOptions(SimulationConfig):
    """What a device that sends lines answers, and when."""

    answer: Annotated[str, MinLen(1)]
    """Its line, with the values by name: `{force:+.3f} N`."""
    ask: str | None = None
    """Question that it answers, without its end; none: it sends by itself."""
    rate: Annotated[float, In("Hz"), Gt(0), Le(100)] = 10.0
    """Lines per second of a device that sends by itself."""
    decimal: Literal["point", "comma"] = "point"
    """What stands in front of the decimals."""
    identity: str = "rigd,simulated lines,1,1.0"
    """Its answer to *IDN?."""
    baud: int = 9600
    """Its baud rate."""

    def check_answer(self, values: Iterable[str]) -> None:
        """Check that the line is made of ``values``.

        Raises:
            ValueError: it has another name, or cannot be filled in.
        """
        try:
            self.answer.format_map(dict.fromkeys(values, 0.0))
        except (KeyError, ValueError, IndexError) as error:
            raise wrong_entry(f"{self.answer!r} cannot be filled in: {error}", "answer") from error

    def part(
        self, name: str, path: Path, values: Callable[[], Mapping[str, float]], seed: int
    ) -> SimLines:
        """Return the device ``name`` at ``path``, which measures ``values()``."""
        return SimLines(
            name, path, values, self.answer, ask=self.ask, interval_s=1.0 / self.rate,
            identity=self.identity, comma=self.decimal == "comma", baud=self.baud, seed=seed,
        )  # fmt: skip


class LineOptions(AnswerOptions):
    """One device that sends lines with values that stand still."""

    values: dict[str, float]
    """What it measures, in the unit of the line."""
    noise: Mapping[str, float] = {}
    """Standard deviation of the noise of values, in their unit."""

    @model_validator(mode="after")
    def _answer_has_values(self) -> Self:
        if unknown := set(self.noise) - set(self.values):
            raise wrong_entry(
                f"`noise` has {min(unknown)!r}, which `values` has not", "noise", min(unknown)
            )
        self.check_answer(self.values)
        return self


class SupplyOptions(SimulationConfig):
    """One programmable supply, which takes its voltage in lines as SCPI has them."""

    highest: Annotated[float, In("V"), Gt(0), Le(1000)] = 30.0
    """Highest voltage that it takes."""
    resistance: Annotated[float, In("ohm"), Gt(0)] = 10.0
    """What is connected to its output."""
    baud: int = 9600
    """Its baud rate."""


class OvenOptions(SimulationConfig):
    """One oven, which takes its temperature by SCPI, on a serial port and perhaps over TCP."""

    port: Annotated[int, Ge(0), Le(65535)] | None = None
    """TCP port of this machine; 0 for any free one, none for a serial port alone."""
    highest: Annotated[float, Gt(0), Le(300)] = 200.0
    """Highest setpoint that it takes, in degC."""
    ambient: Annotated[float, Ge(0), Le(60)] = 21.0
    """Temperature of the room, where it begins, in degC."""
    time_constant: Annotated[float, In("s"), Gt(0), Le(10000)] = 60.0
    """Of the heated mass."""
    baud: int = 9600
    """Its baud rate."""


class WeighOptions(SimulationConfig):
    """One scale."""

    dialect: Literal[
        "mt-sics", "kern-kcp", "and-d", "and-d-indicator", "sartorius-sbi", "ohaus"
    ] = "mt-sics"
    """Its protocol."""
    mass: Annotated[float, In("kg"), Ge(0), Le(60)] = 2.5
    """What lies on it."""
    baud: int = 9600
    """Its baud rate."""


class WireLinesConfig(WireConfig):
    """The devices that send lines; the port of each is its name in the folder."""

    devices: dict[str, LineOptions] = Field(default_factory=dict)
    """Devices by the name of their port."""
    supplies: dict[str, SupplyOptions] = Field(default_factory=dict)
    """Programmable supplies by the name of their port."""
    ovens: dict[str, OvenOptions] = Field(default_factory=dict)
    """Ovens by the name of their port."""
    scales: dict[str, WeighOptions] = Field(default_factory=dict)
    """Scales by the name of their port."""

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        known: set[str] = set()
        for group in ("devices", "supplies", "ovens", "scales"):
            for name in getattr(self, group):
                if name in known:
                    raise wrong_entry(
                        f"two devices have the port {name!r}; give each its own", group, name
                    )
                known.add(name)
        return self


class Values:
    """The values of all devices, which a person may change: ``gauge.force``."""

    def __init__(self, config: WireLinesConfig) -> None:
        self._random = random.Random(config.seed)
        self._devices = config.devices
        self.now = {name: dict(item.values) for name, item in config.devices.items()}
        self.now |= {name: {"mass": item.mass} for name, item in config.scales.items()}

    def of(self, device: str) -> Mapping[str, float]:
        """Return the values of ``device`` with their noise."""
        noise = self._devices[device].noise
        return {
            name: value + self._random.gauss(0.0, noise.get(name, 0.0))
            for name, value in self.now[device].items()
        }

    def mass(self, scale: str) -> float:
        """Return what lies on ``scale``, in kg."""
        return self.now[scale]["mass"]

    def state(self) -> State:
        """Return all values without noise, as ``device_value``."""
        return {
            f"{device}_{name}": value
            for device, values in self.now.items()
            for name, value in values.items()
        }

    def change(self, quantity: str, value: float | str) -> None:
        """Change a value: ``gauge.force``.

        Raises:
            ValueError: there is no such value, or it is no number.

        """
        device, _, name = quantity.partition(".")
        if name not in self.now.get(device, {}):
            known = ", ".join(f"{key}.{item}" for key, items in self.now.items() for item in items)
            raise ValueError(f"there is no {quantity!r}; there are {known}")
        if isinstance(value, str):
            raise ValueError(f"{quantity} is a number, not {value!r}")
        self.now[device][name] = value


class WireLines(WireSimulation):
    """Serves devices that send lines, and a control socket beside them."""

    Config: ClassVar[type[SimulationConfig]] = WireLinesConfig
    title: ClassVar[str] = "devices that send and take lines, each on a serial port"
    config: WireLinesConfig

    def build(self, folder: Folder) -> tuple[World, Sequence[Part]]:
        """Return the values and every device; see :class:`WireSimulation`."""
        values = Values(self.config)
        parts: list[Part] = [
            item.part(name, folder.socket(name), partial(values.of, name), self.config.seed)
            for name, item in self.config.devices.items()
        ]
        parts += [
            SimSupply(
                name, folder.socket(name), highest=item.highest, resistance=item.resistance,
                baud=item.baud, seed=self.config.seed,
            )
            for name, item in self.config.supplies.items()
        ]  # fmt: skip
        parts += [
            SimOven(
                name, folder.socket(name), port=item.port, highest=item.highest,
                ambient=item.ambient, time_constant_s=item.time_constant, baud=item.baud,
                seed=self.config.seed,
            )
            for name, item in self.config.ovens.items()
        ]  # fmt: skip
        parts += [
            SimScale(
                name, folder.socket(name), partial(values.mass, name), dialect=item.dialect,
                baud=item.baud, seed=self.config.seed,
            )
            for name, item in self.config.scales.items()
        ]  # fmt: skip
        return values, parts
