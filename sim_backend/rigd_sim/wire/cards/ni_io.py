"""Simulates a multifunction NI card behind NI's gRPC Device Server, one sample at a time.

The unmodified ``nidaqmx`` package finds analogue inputs and outputs, counters, digital lines and a
watchdog timer. All tasks are timed by software, but those that time pulses into a buffer; one that
asks for a sample clock is refused.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

from rigd_sim.wire.cards.ni_card import DaqFault
from rigd_sim.wire.cards.ni_grpc import Call, GrpcServer, looked_up, session
from rigd_sim.wire.cards.ni_identity import Identity
from rigd_sim.wire.cards.ni_pulses import PulseTimer
from rigd_sim.wire.cards.ni_terminals import COUNTERS, INPUTS, LINES, OUTPUTS, RANGE_V, Terminals
from rigd_sim.wire.part import Part, State

PRODUCT: Final = "PCIe-6363"
#: The card is brought to now this often, so that its watchdog acts when nobody calls, in s.
_TICK_S: Final = 0.002

# Numbers of NI-DAQmx: attributes (nidaqmx.proto, enums *Attribute) and values.
_OUTPUT_RANGES: Final = 0x299B
_TASK_NAME: Final = 0x1276
_EXPIRED: Final = 0x21A8
_RESET_TIMER, _CLEAR_EXPIRATION = 0, 1
_AVAILABLE, _CHANNELS_READ = 0x1223, 0x217B
_TICKS: Final = 10304
_SECONDS, _RISING, _ONE_COUNTER, _CONTINUOUS = 10364, 10280, 10105, 10123
_DECODED: Final = {10090: 1, 10091: 2, 10092: 4}  #: counts per line of the encoder
_HIGH: Final = 10192
_VOLTAGE: Final = 10322
#: A channel or several of one stem, such as ``port0/line0:7``.
_CHANNELS: Final = re.compile(r"([a-z0-9]+/line|[a-z]+)(\d+)(?::(\d+))?")


class Bench(Protocol):
    """What is wired to the card: drives, sensors, a one-shot."""

    faults: Mapping[str, str]

    def state(self) -> State:
        """Return what an observer sees."""

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault; raises ValueError as :meth:`Part.inject`."""

    def clear(self, fault: str | None = None) -> None:
        """Stop showing it."""


@dataclass
class _Task:
    """A task of a client: what it reads or writes."""

    name: str
    inputs: list[int] = field(default_factory=list)
    outputs: list[int] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    drives: bool = False  #: those lines are outputs
    counter: int | None = None
    per_line: int = 0  #: counts per line of an encoder; 0: it counts edges
    zero: int = 0  #: what was counted when it started
    width: bool | None = None  #: it times pulses, with their width or without; None: it counts
    buffer: int = 0  #: of the pulses that it times
    pulses: PulseTimer | None = None  #: once started
    timeout_s: float | None = None  #: it is the watchdog's
    volts: dict[int, float] = field(default_factory=dict)
    levels: dict[str, bool] = field(default_factory=dict)
    running: bool = False

    @property
    def resources(self) -> set[str]:
        """What no other running task may have."""
        kinds = {"ai": bool(self.inputs), "watchdog": self.timeout_s is not None}
        return {
            *(kind for kind, used in kinds.items() if used),
            *(f"ao{output}" for output in self.outputs),
            *(self.lines if self.drives else ()),
            *(() if self.counter is None else (f"ctr{self.counter}",)),
        }


class SimNiIo(Part):
    """One card on a device server of its own, with its bench.

    Args:
        name: the part.
        terminals: of the card.
        bench: what is wired to them.
        address: host:port to serve at; port 0 takes a free one.
        device: name of the card in NI MAX.
        serial: its serial number.
        quadrature: counts that the wires give for each line of an encoder.
    """

    def __init__(
        self,
        name: str,
        terminals: Terminals,
        bench: Bench,
        *,
        address: str = "127.0.0.1:0",
        device: str = "Dev1",
        serial: int = 0x01C0FFEE,
        quadrature: int = 4,
    ) -> None:
        self.name = name
        self.faults = {  # type: ignore[misc] # depends on the bench
            **Terminals.faults,
            "stall": "answers are held back (seconds)",
            **bench.faults,
        }
        self.port = 0  #: where it serves, once started
        self._terminals = terminals
        self._bench = bench
        self._address = address
        self._identity = Identity(device, PRODUCT, serial, lambda: terminals.removed)
        self._quadrature = quadrature
        self._server = GrpcServer(name, address)
        self._tasks: dict[str, _Task] = {}
        self._stall_s = 0.0
        self._calls = 0
        self._timer: asyncio.TimerHandle | None = None
        calls: dict[str, Call] = {
            **self._identity.calls,
            "GetDeviceAttributeDoubleArray": self._device_numbers,
            "CreateTask": self._create_task,
            "CreateWatchdogTimerTaskEx": self._create_watchdog,
            "ClearTask": self._clear_task,
            "StartTask": self._start_task,
            "StopTask": self._stop_task,
            "GetTaskAttributeString": self._task_text,
            "GetErrorString": self._error_text,
            "CreateAIVoltageChan": self._create_input,
            "CreateAOVoltageChan": self._create_output,
            "CreateCIAngEncoderChan": self._create_encoder,
            "CreateCICountEdgesChan": self._create_edges,
            "CreateCIPeriodChan": self._create_period,
            "CreateCIPulseChanTime": self._create_pulses,
            "CfgImplicitTiming": self._time_implicitly,
            "GetReadAttributeUInt32": self._waiting,
            "ReadCounterF64Ex": self._read_periods,
            "ReadCtrTime": self._read_pulses,
            "CreateDOChan": self._create_output_lines,
            "CreateDIChan": self._create_input_lines,
            "CfgWatchdogAOExpirStates": self._expire_volts,
            "CfgWatchdogDOExpirStates": self._expire_lines,
            "ControlWatchdogTask": self._control_watchdog,
            "GetWatchdogAttributeBool": self._watchdog_state,
            "ReadAnalogF64": self._read_volts,
            "WriteAnalogF64": self._write_volts,
            "ReadCounterScalarF64": self._read_encoder,
            "ReadCounterScalarU32": self._read_edges,
            "ReadDigitalLines": self._read_lines,
            "WriteDigitalLines": self._write_lines,
        }
        self._served = {call: self._timed(function) for call, function in calls.items()}

    async def start(self) -> str:
        """Serve at the address; see :meth:`Part.start`."""
        self.port = await self._server.start(self._served)
        self._tick()
        host = self._address.rpartition(":")[0]
        return f"{self.name}: NI {PRODUCT} {self._identity.device} at {host}:{self.port} (gRPC)"

    async def stop(self) -> None:
        """Stop serving; stopping twice is silent."""
        await self._server.stop()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def state(self) -> State:
        """Return what the outputs of the card show, and what the bench does."""
        terminals = self._terminals
        self._advance()
        return {
            "tasks": len(self._tasks),
            "calls": self._calls,
            "removed": terminals.removed,
            "watchdog_running": terminals.timer.running,
            "watchdog_expired": terminals.timer.expired,
            "lines": terminals.lines,
            **{f"ao{output}": volts for output, volts in enumerate(terminals.volts)},
            **self._bench.state(),
        }

    def inject(self, fault: str, **options: Any) -> None:
        """Show a fault of the card, or of what is wired to it."""
        if fault in self._bench.faults:
            self._bench.inject(fault, **options)
        elif fault == "stall":
            seconds = options.pop("seconds", None)
            if options or not isinstance(seconds, int | float) or seconds < 0:
                raise ValueError("fault 'stall' takes seconds, a number of at least 0")
            self._stall_s = float(seconds)
        elif fault in Terminals.faults:
            self._terminals.inject(fault, **options)
            if fault in ("removal", "reset"):
                self._tasks.clear()
        else:
            raise ValueError(
                f"{self.name} has no fault {fault!r}; it knows {', '.join(self.faults)}"
            )

    def clear(self, fault: str | None = None) -> None:
        """Stop showing ``fault``, or all of them."""
        if fault in (None, "stall"):
            self._stall_s = 0.0
        self._terminals.clear(fault)
        self._bench.clear(fault)

    def _advance(self) -> None:
        self._terminals.advance()
        for task in self._tasks.values():
            if task.pulses is not None:
                task.pulses.advance()

    def _tick(self) -> None:
        self._advance()
        self._timer = asyncio.get_running_loop().call_later(_TICK_S, self._tick)

    def _timed(self, call: Callable[[Any], dict[str, Any]]) -> Call:
        async def served(request: Any) -> dict[str, Any]:
            self._calls += 1
            if self._stall_s:
                await asyncio.sleep(self._stall_s)
            self._advance()
            return call(request)

        return served

    def _channels(self, names: str) -> list[str]:
        """Return every channel in ``Dev1/ao0:1, Dev1/ao3``, without the name of the card."""
        found = []
        for item in names.split(","):
            device, _, rest = item.strip().partition("/")
            self._identity.check(device)
            match = _CHANNELS.fullmatch(rest)
            if match is None:
                raise DaqFault(-200170, f"Physical channel specified does not exist: {rest}")
            first, last = int(match[2]), int(match[3] or match[2])
            found += [f"{match[1]}{number}" for number in range(first, last + 1)]
        return found

    def _numbers(self, names: str, stem: str, count: int) -> list[int]:
        """Return the numbers of channels such as ``Dev1/ao0:3``, all with the stem ``ao``."""
        known = [f"{stem}{number}" for number in range(count)]
        return [known.index(name) for name in self._existing(names, known)]

    def _lines(self, names: str) -> list[str]:
        return self._existing(names, LINES)

    def _existing(self, names: str, known: Sequence[str]) -> list[str]:
        channels = self._channels(names)
        for name in channels:
            if name not in known:
                raise DaqFault(-200170, f"Physical channel specified does not exist: {name}")
        return channels

    def _device_numbers(self, request: Any) -> dict[str, Any]:
        self._identity.check(request.device_name)
        ranges = [-5.0, 5.0, -RANGE_V, RANGE_V]
        return {"value": looked_up({_OUTPUT_RANGES: ranges}, request)}

    def _create_task(self, request: Any) -> dict[str, Any]:
        name, new = session(request, self._tasks)
        self._tasks.setdefault(name, _Task(name))
        return {"task": {"name": name}, "new_session_initialized": new}

    def _create_watchdog(self, request: Any) -> dict[str, Any]:
        self._identity.check(request.device_name)
        answer = self._create_task(request)
        self._tasks[answer["task"]["name"]].timeout_s = request.timeout
        return answer

    def _task(self, request: Any) -> _Task:
        task = self._tasks.get(request.task.name)
        if self._terminals.removed:
            raise DaqFault(-201003, "Device cannot be accessed. It may have been disconnected.")
        if task is None:
            raise DaqFault(-200088, "Task specified is invalid or does not exist.")
        return task

    def _clear_task(self, request: Any) -> dict[str, Any]:
        self._stop_task(request)
        del self._tasks[request.task.name]
        return {}

    def _start_task(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        for other in self._tasks.values():
            if other is not task and other.running and other.resources & task.resources:
                raise DaqFault(-50103, "The specified resource is reserved.")
        task.running = True
        timer = self._terminals.timer
        if task.timeout_s is not None:
            timer.volts, timer.levels = task.volts, task.levels
            timer.start(task.timeout_s)
        if task.counter is not None:
            task.zero = self._terminals.counted(task.counter)
        if task.counter is not None and task.width is not None:
            if not task.buffer:
                raise DaqFault(-200077, "The simulated card times pulses into a buffer alone.")
            task.pulses = self._terminals.timed(task.counter, task.buffer)
        return {}

    def _stop_task(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        if task.running and task.timeout_s is not None:
            self._terminals.timer.stop()
        task.running = False
        task.pulses = None
        return {}

    def _running(self, request: Any) -> _Task:
        task = self._task(request)
        if not task.running:
            raise DaqFault(-200983, "The task is not running.")
        return task

    def _task_text(self, request: Any) -> dict[str, Any]:
        return {"value": looked_up({_TASK_NAME: self._task(request).name}, request)}

    def _error_text(self, request: Any) -> dict[str, Any]:
        return {"error_string": f"NI-DAQmx reports status {request.error_code}."}

    def _create_input(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        task.inputs += self._numbers(request.physical_channel, "ai", INPUTS)
        return {}

    def _create_output(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        if max(-request.min_val, request.max_val) > RANGE_V:
            raise DaqFault(-200077, "Requested value is not a supported value for this property.")
        task.outputs += self._numbers(request.physical_channel, "ao", OUTPUTS)
        return {}

    def _create_encoder(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        per_line = _DECODED.get(request.decoding_type_raw)
        if request.units_raw != _TICKS or request.zidx_enable or per_line is None:
            raise DaqFault(-200077, "The simulated card counts ticks, without an index.")
        (task.counter,) = self._numbers(request.counter, "ctr", COUNTERS)
        task.per_line = per_line
        return {}

    def _create_edges(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        (task.counter,) = self._numbers(request.counter, "ctr", COUNTERS)
        return {}

    def _create_period(self, request: Any) -> dict[str, Any]:
        if (request.edge_raw, request.meas_method_raw) != (_RISING, _ONE_COUNTER):
            raise DaqFault(-200077, "The simulated card times rising edges by one counter.")
        return self._create_timed(request, width=False)

    def _create_pulses(self, request: Any) -> dict[str, Any]:
        return self._create_timed(request, width=True)

    def _create_timed(self, request: Any, *, width: bool) -> dict[str, Any]:
        task = self._task(request)
        if request.units_raw != _SECONDS or not 0 < request.min_val < request.max_val:
            raise DaqFault(-200077, "The simulated card times pulses in seconds.")
        (task.counter,) = self._numbers(request.counter, "ctr", COUNTERS)
        task.width = width
        return {}

    def _time_implicitly(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        if request.sample_mode_raw != _CONTINUOUS or task.width is None:
            raise DaqFault(-200077, "The simulated card times pulses without an end.")
        task.buffer = request.samps_per_chan
        return {}

    def _timer_of(self, request: Any, *, width: bool | None = None) -> PulseTimer:
        task = self._running(request)
        if task.pulses is None or width not in (None, task.width):
            raise DaqFault(-200077, "The task times no such pulses.")
        return task.pulses

    def _waiting(self, request: Any) -> dict[str, Any]:
        waiting = self._timer_of(request).waiting
        return {"value": looked_up({_AVAILABLE: waiting, _CHANNELS_READ: 1}, request)}

    def _read_periods(self, request: Any) -> dict[str, Any]:
        pulses = self._timer_of(request, width=False).take(request.num_samps_per_chan)
        return {"read_array": [sum(pulse) for pulse in pulses], "samps_per_chan_read": len(pulses)}

    def _read_pulses(self, request: Any) -> dict[str, Any]:
        pulses = self._timer_of(request, width=True).take(request.num_samps_per_chan)
        high, low = zip(*pulses, strict=True)
        return {
            "read_array_high_time": high,
            "read_array_low_time": low,
            "samps_per_chan_read": len(pulses),
        }

    def _create_output_lines(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        task.lines += self._lines(request.lines)
        task.drives = True
        return {}

    def _create_input_lines(self, request: Any) -> dict[str, Any]:
        self._task(request).lines += self._lines(request.lines)
        return {}

    def _watchdog(self, request: Any) -> _Task:
        task = self._task(request)
        if task.timeout_s is None:
            raise DaqFault(-200088, "The task is not a watchdog timer task.")
        return task

    def _expire_volts(self, request: Any) -> dict[str, Any]:
        task = self._watchdog(request)
        if not self._terminals.guards_volts:
            raise DaqFault(-200077, "This card guards digital lines alone.")
        numbers = self._numbers(request.channel_names, "ao", OUTPUTS)
        if any(kind != _VOLTAGE for kind in request.output_type_array):
            raise DaqFault(-200077, "The simulated card expires to voltages alone.")
        task.volts |= dict(zip(numbers, request.expir_state_array, strict=True))
        return {}

    def _expire_lines(self, request: Any) -> dict[str, Any]:
        task = self._watchdog(request)
        levels = (state == _HIGH for state in request.expir_state_array)
        task.levels |= dict(zip(self._lines(request.channel_names), levels, strict=True))
        return {}

    def _control_watchdog(self, request: Any) -> dict[str, Any]:
        self._watchdog(request)
        timer = self._terminals.timer
        if request.action_raw == _CLEAR_EXPIRATION:
            timer.expired = False
            timer.reset()
        elif not timer.expired:
            timer.reset()
        return {}

    def _watchdog_state(self, request: Any) -> dict[str, Any]:
        self._watchdog(request)
        return {"value": looked_up({_EXPIRED: self._terminals.timer.expired}, request)}

    def _read_volts(self, request: Any) -> dict[str, Any]:
        task = self._running(request)
        if request.num_samps_per_chan != 1:
            raise DaqFault(-200077, "The simulated card gives one sample at a time.")
        volts = [self._terminals.volts_at(number) for number in task.inputs]
        return {"read_array": volts, "samps_per_chan_read": 1}

    def _write_volts(self, request: Any) -> dict[str, Any]:
        task = self._running(request)
        volts = list(request.write_array)
        if len(volts) != len(task.outputs) or any(abs(item) > RANGE_V for item in volts):
            raise DaqFault(-200077, "A voltage for each output is needed, within its range.")
        self._terminals.set_volts(task.outputs[0], volts)
        return {"samps_per_chan_written": 1}

    def _read_encoder(self, request: Any) -> dict[str, Any]:
        counted = self._counted(request)
        return {"value": float((counted + 2**31) % 2**32 - 2**31)}

    def _read_edges(self, request: Any) -> dict[str, Any]:
        return {"value": self._counted(request) % 2**32}

    def _counted(self, request: Any) -> int:
        task = self._running(request)
        if task.counter is None:
            raise DaqFault(-200077, "The task has no counter.")
        counted = self._terminals.counted(task.counter) - task.zero
        return counted * task.per_line // self._quadrature if task.per_line else counted

    def _read_lines(self, request: Any) -> dict[str, Any]:
        task = self._running(request)
        return {
            "read_array": bytes(map(self._terminals.level, task.lines)),
            "samps_per_chan_read": 1,
            "num_bytes_per_samp": len(task.lines),
        }

    def _write_lines(self, request: Any) -> dict[str, Any]:
        task = self._running(request)
        levels = [bool(level) for level in request.write_array]
        if not task.drives or len(levels) != len(task.lines):
            raise DaqFault(-200077, "The simulated card takes one level for each output line.")
        self._terminals.set_lines(dict(zip(task.lines, levels, strict=True)))
        return {"samps_per_chan_written": 1}
