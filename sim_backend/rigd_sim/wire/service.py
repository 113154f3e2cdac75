"""Serves the devices of a simulated rig, injects their faults, and answers requests about them.

All devices of a rig run in one process, on one asyncio loop, and share one plant in real time.
"""

from __future__ import annotations

import asyncio
import selectors
import time
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Final, Protocol

from pydantic import ValidationError

from rigd.model.errors import ConfigError
from rigd.sdk import LinkError, PlantConfig, Setting, Simulation, SimulationConfig
from rigd_sim.wire.control import ControlServer, ask
from rigd_sim.wire.faults import FaultEntry, Schedule, read_fault_file
from rigd_sim.wire.folder import Folder
from rigd_sim.wire.pace import in_real_time
from rigd_sim.wire.part import Part, State

#: How often faults that are planned are checked, in s; the plant moves on whenever it is asked.
TICK_S: Final = 0.005
#: The same while none is planned, so that a bench that is not used takes no time of the machine.
IDLE_S: Final = 0.02
CONTROL: Final = "control"
WITHOUT_PRIORITY: Final = (
    "no real-time priority (RLIMIT_RTPRIO or CAP_SYS_NICE): on a busy machine devices answer late"
)
#: A plant in real time has no cycle of its own; this is the period that it is given.
PLANT_PERIOD_NS: Final = 1_000_000


class World(Protocol):
    """The physics that the devices of a bench share, in real time."""

    def state(self) -> State:
        """Return the hidden state of this moment, and what people have set up."""
        ...

    def change(self, quantity: str, value: float | str) -> None:
        """Change what a person would change at the bench; see :meth:`rigd.sdk.Plant.change`."""
        ...


class WireConfig(SimulationConfig):
    """The folder of the simulated devices' sockets and ports, and their faults."""

    folder: Path
    """Where their sockets and serial ports stand; short, since names of sockets are."""
    seed: int = 1
    """Of the noise of all sensors, and of faults by chance."""
    faults: tuple[FaultEntry, ...] = ()
    """Faults that the devices show from the start, as in a fault file."""


class WirePlantConfig(WireConfig):
    """The options of devices that share a plant."""

    plant: PlantConfig
    """The physics."""


class WireSimulation(Simulation):
    """Serves the devices of one rig, and a control socket beside them."""

    config: WireConfig

    @abstractmethod
    def build(self, folder: Folder) -> tuple[World, Sequence[Part]]:
        """Return the world and its parts, in the order in which they are listed."""

    def ask(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        """Ask the process that serves; see :meth:`rigd.sdk.Simulation.ask`.

        ``state`` also gives the plant's hidden state; ``fault`` takes ``part``, ``fault``,
        ``options``, ``after_s``, ``for_s``, ``probability`` (1/s) and ``when``; ``clear`` takes
        ``part`` and ``fault``; ``faults`` lists all that every part has. What is done is
        answered by ``t_ns``, the CLOCK_MONOTONIC time at which it was begun.
        """
        return ask(self.config.folder / CONTROL, request)

    def serve(
        self,
        started: Callable[[Sequence[str]], None],
        stop: Callable[[], bool],
        faults: Path | None = None,
    ) -> None:
        """Serve until ``stop()``; see :meth:`rigd.sdk.Simulation.serve`."""
        planned = [*self.config.faults, *([] if faults is None else read_fault_file(faults))]
        with Folder(self.config.folder) as folder:
            world, parts = self.build(folder)
            service = _Service(world, parts, folder.socket(CONTROL), self.config.seed)
            with asyncio.Runner(loop_factory=precise_loop) as runner, in_real_time() as prompt:
                remark = [] if prompt else [WITHOUT_PRIORITY]
                runner.run(service.run(lambda lines: started([*lines, *remark]), stop, planned))


def precise_loop() -> asyncio.AbstractEventLoop:
    """Return an event loop whose timers are good to a fraction of a millisecond.

    epoll rounds a time-out up to the next millisecond, select does not.
    """
    return asyncio.SelectorEventLoop(selectors.SelectSelector())


class WirePlantSimulation(WireSimulation):
    """Serves devices that stand on one plant."""

    @classmethod
    def files(cls, config: WirePlantConfig) -> Mapping[Path, str]:
        """Return the file of physical parameters; see :meth:`PlantConfig.files`."""
        return config.plant.files()

    @classmethod
    def settings(cls, config: WirePlantConfig) -> Mapping[str, Setting]:
        """Return the settings of the plant; see :meth:`PlantConfig.settings`."""
        return config.plant.settings()


class _Service:
    """One run of the bench."""

    def __init__(self, world: World, parts: Sequence[Part], control: Path, seed: int) -> None:
        self._world = world
        self._parts = {part.name: part for part in parts}
        states = {part.name: part.state for part in parts}
        self._schedule = Schedule(self._parts, {**states, "plant": world.state}, seed)
        self._control = ControlServer(control, self._answer)
        self._problems: list[str] = []

    async def run(
        self,
        started: Callable[[Sequence[str]], None],
        stop: Callable[[], bool],
        planned: Sequence[FaultEntry],
    ) -> None:
        """Start everything, serve, and stop everything, also after an error."""
        loop = asyncio.get_running_loop()
        failed: asyncio.Future[None] = loop.create_future()

        def fail(_: object, context: Mapping[str, Any]) -> None:
            error = context.get("exception") or RuntimeError(str(context["message"]))
            if not failed.done():
                failed.set_exception(error)

        loop.set_exception_handler(fail)
        async with AsyncExitStack() as stack:  # stops all, also if one of them fails to stop
            for part in self._parts.values():
                stack.push_async_callback(part.stop)
            stack.push_async_callback(self._control.stop)
            lines = await self._start()
            for entry in planned:
                self._plan(entry)
            started(lines)
            while not stop():
                refused = self._schedule.tick(loop.time())
                if refused and planned:
                    raise ConfigError("; ".join(refused))
                self._problems += refused
                await asyncio.wait([failed], timeout=TICK_S if self._schedule.planned else IDLE_S)
                if failed.done():
                    failed.result()

    async def _start(self) -> list[str]:
        parts = list(self._parts.values())
        done = await asyncio.gather(*(part.start() for part in parts), return_exceptions=True)
        lines, problems = [], []
        for part, result in zip(parts, done, strict=True):
            if isinstance(result, OSError):
                problems.append(f"{part.name}: {result}")
            elif isinstance(result, BaseException):
                raise result
            else:
                lines.append(result)
        if problems:
            raise LinkError(
                "cannot serve " + "; ".join(problems),
                hint="another program has that name or port; change it under `simulation:`",
            )
        await self._control.start()
        return lines

    def _plan(self, entry: FaultEntry) -> None:
        try:
            self._schedule.add(entry, asyncio.get_running_loop().time())
        except ValueError as error:
            raise ConfigError(f"fault {entry.fault!r} of {entry.part!r}: {error}") from error

    def _answer(self, request: Mapping[str, Any]) -> Mapping[str, Any]:
        """Answer one request; raise ValueError if it cannot be met."""
        given, t_ns = dict(request), time.monotonic_ns()
        match given.pop("do", None):
            case "state":
                return self._state(given)
            case "change":
                self._world.change(*_exactly(given, "quantity", "value"))
            case "fault":
                self._schedule.add(_entry(given), asyncio.get_running_loop().time())
            case "clear":
                self._schedule.clear(_name(given, "part"), _name(given, "fault"))
                _exactly(given)
            case "faults":
                _exactly(given)
                return {"parts": {name: dict(part.faults) for name, part in self._parts.items()}}
            case other:
                raise ValueError(
                    f"cannot do {other!r}; `do` is state, change, fault, clear or faults"
                )
        return {"t_ns": t_ns}

    def _state(self, given: Mapping[str, Any]) -> Mapping[str, Any]:
        _exactly(given)
        return {
            "t_ns": time.monotonic_ns(),
            "parts": {name: dict(part.state()) for name, part in self._parts.items()},
            "plant": dict(self._world.state()),
            "problems": self._problems,
        }


def _exactly(given: Mapping[str, Any], *names: str) -> list[Any]:
    """Return the values of ``names``, and refuse others."""
    missing, unknown = set(names) - set(given), set(given) - set(names)
    if missing or unknown:
        raise ValueError(
            f"expected {', '.join(names) or 'nothing more'}; "
            f"missing {sorted(missing)}, unknown {sorted(unknown)}"
        )
    return [given[name] for name in names]


def _name(given: dict[str, Any], key: str) -> str | None:
    """Remove the name that may stand at ``key`` and return it."""
    name = given.pop(key, None)
    if name is not None and not isinstance(name, str):
        raise ValueError(f"{key!r} is {name!r}, expected a name")
    return name


def _entry(given: Mapping[str, Any]) -> FaultEntry:
    """Return the entry that a request describes: times in s, chances per second."""
    words = {"after_s": ("at", "s"), "for_s": ("for", "s"), "probability": ("probability", "1/s")}
    written = dict(given)
    for name, (key, unit) in words.items():
        if written.get(name) is not None:
            written[key] = f"{written.pop(name)!r} {unit}"
        else:
            written.pop(name, None)
    try:
        return FaultEntry.model_validate(written)
    except ValidationError as error:
        problems = error.errors(include_url=False, include_context=False)
        raise ValueError(
            "; ".join(f"{'.'.join(map(str, problem['loc'])) or 'fault'}: {problem['msg']}"
                      for problem in problems)
        ) from error  # fmt: skip
