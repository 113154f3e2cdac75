"""Simulates NI's gRPC Device Server with one simulated card.

The server uses the published protocol (nidaqmx.proto of ni/grpc-device, as compiled in nidaqmx's
own stubs). It serves the calls in :attr:`DeviceServer.calls`. A partial read sends its error as the
status of an answer that carries data.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Container, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from rigd_sim.wire.cards.ni_card import (
    Acquisition,
    DaqFault,
    Faults,
    Sampling,
    Span,
    rate_for,
    span_for,
)
from rigd_sim.wire.cards.ni_grpc import Call, looked_up, session
from rigd_sim.wire.cards.ni_identity import Identity
from rigd_sim.wire.cards.ni_lines import Lines, parsed

PRODUCT: Final = "USB-6009"

# Numbers of NI-DAQmx: attributes (nidaqmx.proto, enums *Attribute) and values.
_TASK_NAME, _TASK_CHANNELS, _TASK_DEVICES = 0x1276, 0x1273, 0x230E
_CHANNEL_COUNTS: Final = frozenset({0x2181, 0x217B})  # of the task, of what is read
_AVAILABLE: Final = frozenset({0x1223, 0x31E8})  # samples waiting, samples read by default
_READ_POSITION: Final = 0x1221
_SAMPLE_RATE: Final = 0x1344
_RANGE_HIGH, _RANGE_LOW = 0x1815, 0x1816
_CHANNEL_TYPE, _ANALOG_INPUT = 0x187F, 10100
_CONTINUOUS: Final = 10123
_BY_CHANNEL: Final = 0
_NOT_YET_AVAILABLE: Final = -200284


@dataclass
class _Task:
    """A task of a client: what it has set up, and the acquisition while it runs."""

    name: str
    inputs: dict[str, Span] = field(default_factory=dict)  # by physical channel
    rate_hz: float = 0.0
    capacity: int = 0
    running: Acquisition | None = None
    lines: tuple[str, ...] = ()  # digital, in the order in which they were named
    drives: bool = False  # those lines are outputs
    reserves: bool = False  # and no other's, from start to stop


class DeviceServer:
    """One card, its tasks and the calls of their clients.

    Args:
        device: name of the card in NI MAX.
        serial: its serial number.
        connected: inputs that something is wired to.
        sample: begins to sample the inputs of a task.
        lines: its digital lines.
        faults: what it shows.
        drift_ppm: by how much its crystal runs fast, unless a fault changes it.
    """

    def __init__(
        self,
        device: str,
        serial: int,
        connected: Container[str],
        sample: Sampling,
        lines: Lines,
        faults: Faults,
        *,
        drift_ppm: float,
    ) -> None:
        self.identity = Identity(device, PRODUCT, serial, lambda: faults.removal)
        self._connected = connected
        self._sample = sample
        self._lines = lines
        self._shown = faults
        self._drift_ppm = drift_ppm
        self._tasks: dict[str, _Task] = {}
        self._advanced = asyncio.Condition()
        #: The calls that are served, by their names in nidaqmx.proto.
        self.calls: Mapping[str, Call] = {
            **self.identity.calls,
            "CreateTask": self._create_task,
            "ClearTask": self._clear_task,
            "CreateAIVoltageChan": self._create_voltage_channel,
            "CfgSampClkTiming": self._configure_clock,
            "StartTask": self._start_task,
            "StopTask": self._stop_task,
            "ReadAnalogF64": self._read,
            "CreateDOChan": self._create_output_lines,
            "CreateDIChan": self._create_input_lines,
            "WriteDigitalLines": self._write_lines,
            "ReadDigitalLines": self._read_lines,
            "GetTaskAttributeString": self._task_text,
            "GetTaskAttributeUInt32": self._task_number,
            "GetReadAttributeUInt32": self._task_number,
            "GetReadAttributeUInt64": self._read_position,
            "GetTimingAttributeDouble": self._timing_number,
            "GetChanAttributeDouble": self._channel_number,
            "GetChanAttributeInt32": self._channel_kind,
            "GetErrorString": self._error_text,
        }

    @property
    def tasks(self) -> int:
        """How many tasks its clients have."""
        return len(self._tasks)

    @property
    def running(self) -> Acquisition | None:
        """The acquisition that is under way."""
        return next((task.running for task in self._tasks.values() if task.running), None)

    async def advance(self) -> None:
        """Convert what is due, and wake the calls that wait for samples."""
        if self.running is not None and not self._shown.removal:
            ppm = self._drift_ppm if self._shown.drift is None else self._shown.drift
            self.running.advance(time.monotonic_ns(), ppm * 1e-6, self._shown)
        async with self._advanced:
            self._advanced.notify_all()

    def _task(self, request: Any) -> _Task:
        task = self._tasks.get(request.task.name)
        if task is None:
            raise DaqFault(-200088, "Task specified is invalid or does not exist.")
        return task

    def _present(self) -> None:
        if self._shown.removal:
            raise DaqFault(-201003, "Device cannot be accessed. It may have been disconnected.")

    def _create_task(self, request: Any) -> dict[str, Any]:
        name, new = session(request, self._tasks)
        self._tasks.setdefault(name, _Task(name))
        return {"task": {"name": name}, "new_session_initialized": new}

    def _clear_task(self, request: Any) -> dict[str, Any]:
        del self._tasks[self._task(request).name]
        return {}

    def _create_voltage_channel(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        device, _, channel = request.physical_channel.partition("/")
        self.identity.check(device)
        asked = max(abs(request.min_val), abs(request.max_val))
        span = span_for(channel, request.terminal_config_raw, asked)
        task.inputs[request.physical_channel] = span
        return {}

    def _configure_clock(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        if request.sample_mode_raw != _CONTINUOUS:
            raise DaqFault(-200077, "The simulated card samples continuously only.")
        task.rate_hz = rate_for(request.rate, len(task.inputs))
        task.capacity = request.samps_per_chan
        return {}

    def _start_task(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        self._present()
        if task.lines:
            self._free(task)
            task.reserves = True
            return {}
        if self.running is not None:
            raise DaqFault(-50103, "The specified resource is reserved.")
        spans = {name.partition("/")[2]: span for name, span in task.inputs.items()}
        sampler = self._sample(spans, task.rate_hz, time.monotonic_ns())
        task.running = Acquisition(spans, task.rate_hz, task.capacity, sampler, self._connected)
        return {}

    def _stop_task(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        task.running, task.reserves = None, False
        return {}

    async def _read(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        if task.running is None:
            raise DaqFault(-200983, "The task is not running.")
        if request.fill_mode_raw != _BY_CHANNEL:
            raise DaqFault(-200077, "The simulated card groups by channel only.")
        running, wanted = task.running, request.num_samps_per_chan
        deadline = None if request.timeout < 0 else request.timeout
        if wanted < 0:
            wanted = running.available
        if self._shown.short_block:
            wanted //= 2
        try:
            async with asyncio.timeout(deadline), self._advanced:
                await self._advanced.wait_for(
                    lambda: running.available >= wanted or running.overrun or self._shown.removal
                )
        except TimeoutError:
            pass  # what there is goes out, with the status that reports it
        if self._shown.stall:
            await asyncio.sleep(self._shown.stall)
        self._present()
        samples = running.take(min(wanted, running.available))
        full = samples.shape[1] == request.num_samps_per_chan or request.num_samps_per_chan < 0
        # A partial read is packed at the beginning of the array (nidaqmx-python issue 528).
        packed = np.zeros(request.array_size_in_samps)
        packed[: samples.size] = samples.ravel()
        return {
            "status": 0 if full else _NOT_YET_AVAILABLE,
            "read_array": packed.tolist(),  # twice as fast into a message as an array
            "samps_per_chan_read": samples.shape[1],
        }

    def _create_output_lines(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        task.lines += parsed(request.lines, self.identity.device)
        task.drives = True
        return {}

    def _create_input_lines(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        task.lines += parsed(request.lines, self.identity.device)
        self._lines.release(task.lines)
        return {}

    async def _write_lines(self, request: Any) -> dict[str, Any]:
        task = await self._line_task(request)
        levels = request.write_array
        if not task.drives or request.num_samps_per_chan != 1 or len(levels) != len(task.lines):
            raise DaqFault(-200077, "The simulated card takes one level for each output line.")
        if not (request.auto_start or task.reserves):
            raise DaqFault(-200846, "The task must be started before it can be written to.")
        self._lines.drive(dict(zip(task.lines, map(bool, levels), strict=True)))
        return {"samps_per_chan_written": 1}

    async def _read_lines(self, request: Any) -> dict[str, Any]:
        task = await self._line_task(request)
        if request.num_samps_per_chan != 1 or request.array_size_in_bytes < len(task.lines):
            raise DaqFault(-200077, "The simulated card gives one level for each line.")
        return {
            "read_array": bytes(map(self._lines.level, task.lines)),
            "samps_per_chan_read": 1,
            "num_bytes_per_samp": len(task.lines),
        }

    async def _line_task(self, request: Any) -> _Task:
        """Return a task whose lines are accessed now."""
        if self._shown.stall:
            await asyncio.sleep(self._shown.stall)
        task = self._task(request)
        self._present()
        if not task.lines:
            raise DaqFault(-200077, "The task has no digital lines.")
        self._free(task)
        return task

    def _free(self, task: _Task) -> None:
        """Make sure that no other task has reserved the lines of ``task``."""
        for other in self._tasks.values():
            if other is not task and other.reserves and set(other.lines) & set(task.lines):
                raise DaqFault(-200587, "Specified digital lines are reserved or unavailable.")

    def _task_text(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        texts = {
            _TASK_NAME: task.name,
            _TASK_CHANNELS: ", ".join(task.inputs),
            _TASK_DEVICES: self.identity.device if task.inputs else "",
        }
        return {"value": looked_up(texts, request)}

    def _task_number(self, request: Any) -> dict[str, Any]:
        task = self._task(request)
        if request.attribute_raw in _AVAILABLE:
            return {"value": 0 if task.running is None else task.running.available}
        return {"value": looked_up(dict.fromkeys(_CHANNEL_COUNTS, len(task.inputs)), request)}

    def _read_position(self, request: Any) -> dict[str, Any]:
        running = self._task(request).running
        return {"value": looked_up({_READ_POSITION: running.taken if running else 0}, request)}

    def _timing_number(self, request: Any) -> dict[str, Any]:
        return {"value": looked_up({_SAMPLE_RATE: self._task(request).rate_hz}, request)}

    def _channel_number(self, request: Any) -> dict[str, Any]:
        high = self._span(request).range_v
        return {"value": looked_up({_RANGE_HIGH: high, _RANGE_LOW: -high}, request)}

    def _channel_kind(self, request: Any) -> dict[str, Any]:
        self._span(request)
        return {"value_raw": looked_up({_CHANNEL_TYPE: _ANALOG_INPUT}, request)}

    def _span(self, request: Any) -> Span:
        span = self._task(request).inputs.get(request.channel)
        if span is None:
            raise DaqFault(-200170, f"Channel {request.channel} does not exist.")
        return span

    def _error_text(self, request: Any) -> dict[str, Any]:
        return {"error_string": f"NI-DAQmx reports status {request.error_code}."}
