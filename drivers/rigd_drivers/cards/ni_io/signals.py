"""Reads and writes the signals of one NI card through tasks of NI-DAQmx, one sample at a time.

All tasks are timed by software (on demand): each call takes or gives the present value. ``nidaqmx``
ships no types, so its values are ``Any``.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any, Final

import numpy as np

from rigd.sdk import DeviceError, LinkError
from rigd_drivers.call_time import CallTime
from rigd_drivers.cards.card import Train
from rigd_drivers.cards.ni_card import NiCard
from rigd_drivers.cards.ni_io.config import NiIoConfig, WatchdogOptions
from rigd_drivers.cards.ni_io.pulses import PulseReader
from rigd_drivers.wait import looks

#: Longest answer of the card or of its device server, in s,
CALL_S: Final = 0.5
#: and of all answers of one half of a cycle together: it must not hang on one that is away, and
#: has to report that before it counts as silent itself (250 ms in the shipped rigs).
CYCLE_S: Final = 0.15
#: Both ends of what an analogue input or output of such a card spans, in V.
RANGE_V: Final = 10.0
_TOO_FAST: Final = (
    "the pulses come faster than the cycle takes them: count them with `edge_counters` and "
    "`card-pulses`"
)
#: What a rig file can ask for and a card refuse: PHYSICAL_CHAN_DOES_NOT_EXIST, a value that a
#: property does not support, DIGITAL_OUTPUT_NOT_SUPPORTED, DIGITAL_INPUT_NOT_SUPPORTED,
#: PHYS_CHAN_MEAS_TYPE; SAMPLES_NO_LONGER_AVAILABLE, COUNTER_OVERFLOW, INPUT_FIFO_OVERFLOW_2.
_REFUSED: Final[Mapping[int, str]] = {
    -200170: "correct the number of the input, output or counter; NI MAX shows what the card has",
    -200077: "correct `terminal`, `decoding` or `slowest`; NI MAX shows what the card can do",
    -200012: "correct `output_lines`; NI MAX shows which lines the card has",
    -200011: "correct `input_lines`; NI MAX shows which lines the card has",
    -200431: "this counter cannot measure that; without `width` more cards time pulses",
    -200279: _TOO_FAST,
    -200141: _TOO_FAST,
    -200361: _TOO_FAST,
}
#: The outputs stand where the watchdog has put them: WRITE_FAILED_BECAUSE_WATCHDOG_EXPIRED,
#: CHASSIS_WATCHDOG_TIMER_EXPIRED, PROGRAMMED_IO_FAILS_BECAUSE_OF_WATCHDOG_TIMER.
_EXPIRED: Final = frozenset({-200678, -201478, -201229})
#: Another connection does the same at this moment: INVALID_TASK, RESOURCE_RESERVED.
_CROSSED: Final = frozenset({-200088, -50103, -200587})
#: For so long a rescue waits for another, in s.
_CROSSED_S: Final = 0.5
_LOOK_S: Final = 0.02


class Expired(DeviceError):
    """The watchdog of the card has expired: its outputs stand at rest and take nothing else."""


class Signals:
    """The tasks of one card; calls wait for the card. For one thread.

    Args:
        config: which card, and what of it is used.
    """

    def __init__(self, config: NiIoConfig) -> None:
        self._config = config
        self.call_time = CallTime(CALL_S)
        self._card = NiCard(config, _REFUSED, call_s=self.call_time.left_s)
        self._tasks: dict[str, Any] = {}
        self._volts_out: Any = None
        self._lines_out: Any = None
        self._lines_in: Any = None
        self._volts_in: Any = None
        self._counters: dict[int, Any] = {}
        self._pulses: dict[int, PulseReader] = {}
        self._watchdog: Any = None
        self._put_volts: list[float] = []  # what the card has confirmed last
        self._put_lines: list[bool] = []
        self._fed_s = 0.0
        self._volts = np.zeros(0)
        self._levels = np.zeros(len(config.inputs), dtype=bool)

    def __str__(self) -> str:
        return str(self._card)

    @property
    def resting_lines(self) -> list[bool]:
        """The level of each digital output at rest."""
        high = self._config.high_at_rest
        return [line in high for line in range(len(self._config.outputs))]

    @property
    def watched(self) -> bool:
        """Whether the watchdog of the card runs."""
        return self._watchdog is not None

    def open(self) -> str:
        """Take the outputs, bring them to rest, and return how the card identifies itself.

        Raises:
            LinkError: NI-DAQmx, its server or the card is not there, or another program uses it.
            ProtocolError: it is another card than the rig file names.
            DeviceError: the card has not what the rig file asks for.
        """
        identity = self._card.open()
        with self._doing("take outputs of"):
            self._clear_left_over()
            self._check_range()
            self._open_outputs()
            if self._config.inputs:
                task = self._new_task("di")
                task.di_channels.add_di_chan(self._names(self._config.inputs))
                task.start()
                self._lines_in = _line_reader(task)
        try:
            self.rest()
        except Expired:
            with self._doing("unlock"):
                self._unlock()
            self.rest()
        return identity

    def close(self) -> None:
        """Release everything; the outputs keep their levels. Closing twice is silent."""
        tasks, self._tasks = self._tasks, {}
        self._volts_out = self._lines_out = self._lines_in = self._volts_in = None
        self._watchdog = None
        self._counters, self._pulses = {}, {}
        self._put_volts, self._put_lines = [], []
        try:
            for task in tasks.values():
                with suppress(self._card.errors.Error):
                    task.close()
        finally:
            self._card.close()

    def rescue(self) -> None:
        """Bring the outputs to rest over a connection of its own; for signals not open.

        Raises:
            LinkError: the card cannot be reached.
            DeviceError: it does not take it.
        """
        self._card.connect()
        until = time.monotonic() + _CROSSED_S
        try:
            while not self._rescued(patient=time.monotonic() < until):
                time.sleep(_LOOK_S)
        finally:
            self.close()

    def use_volts(self, inputs: Sequence[int]) -> None:
        """Read these analogue inputs from now on, in this order."""
        with self._doing("take inputs of"):
            self._end_task("ai")
            if not inputs:
                return
            task = self._new_task("ai")
            for number in inputs:
                task.ai_channels.add_ai_voltage_chan(
                    f"{self._config.device}/ai{number}",
                    terminal_config=self._terminal(),
                    min_val=-RANGE_V,
                    max_val=RANGE_V,
                )
            task.start()
            self._volts = np.zeros(len(inputs))
            self._volts_in = _volt_reader(task)

    def use_counter(self, number: int) -> None:
        """Count what comes in at this counter from now on, from 0."""
        if number in self._counters:
            return
        from nidaqmx.stream_readers import CounterReader

        name = f"{self._config.device}/ctr{number}"
        with self._doing("take a counter of"):
            task = self._new_task(f"ctr{number}")
            if number in self._config.edge_counters:
                task.ci_channels.add_ci_count_edges_chan(name)
            else:
                self._add_encoder(task, name)
            task.start()
            self._counters[number] = CounterReader(task.in_stream)

    def use_pulses(self, number: int, *, longest_s: float, width: bool) -> None:
        """Time the pulses at this counter from now on; see :class:`PulseReader`."""
        name = f"{self._config.device}/ctr{number}"
        with self._doing("take a counter of"):
            task = self._new_task(f"ctr{number}")
            self._pulses[number] = PulseReader(task, name, longest_s=longest_s, width=width)

    def train(self, number: int) -> Train:
        """Return the pulses at this counter, without waiting for one."""
        with self._doing("read a counter of"):
            return self._pulses[number].take(self.call_time.left_s())

    def volts(self) -> list[float]:
        """Return the volts at the analogue inputs in use."""
        if self._volts_in is None:
            return []
        with self._doing("read inputs of"):
            self._volts_in.read_one_sample(self._volts, self.call_time.left_s())
        volts: list[float] = self._volts.tolist()
        return volts

    def count(self, number: int) -> int:
        """Return the counter as an unsigned number of 32 bits."""
        with self._doing("read a counter of"):
            reader = self._counters[number]
            if number in self._config.edge_counters:
                return int(reader.read_one_sample_uint32(self.call_time.left_s()))
            return (
                round(float(reader.read_one_sample_double(self.call_time.left_s()))) & 0xFFFF_FFFF
            )

    def levels(self) -> list[bool]:
        """Return the levels of all digital inputs."""
        if self._lines_in is None:
            return []
        with self._doing("read lines of"):
            self._lines_in.read_one_sample_multi_line(self._levels)
        levels: list[bool] = self._levels.tolist()
        return levels

    def put(self, volts: Sequence[float], lines: Sequence[bool], *, again: bool = False) -> None:
        """Give the analogue outputs, then the digital outputs.

        Args:
            volts: of every analogue output.
            lines: of every digital output.
            again: also what the card has already.

        Raises:
            Expired: the watchdog of the card has expired.
            LinkError: the device server does not answer.
            DeviceError: the card does not.
        """
        with self._doing("write to"):
            if volts and (again or volts != self._put_volts):
                self._put_volts = []
                self._volts_out.write_one_sample(
                    np.array(volts, dtype=np.float64), self.call_time.left_s()
                )
                self._put_volts = list(volts)
            if again or lines != self._put_lines:
                self._put_lines = []
                self._lines_out.write_one_sample_multi_line(
                    np.array(lines, dtype=bool), self.call_time.left_s()
                )
                self._put_lines = list(lines)

    def put_lines_first(
        self, volts: Sequence[float], lines: Sequence[bool], *, again: bool = False
    ) -> None:
        """Give the digital outputs, then the analogue ones: either also if the other fails.

        See :meth:`put`.
        """
        try:
            self.put((), lines, again=again)
        finally:
            self.put(volts, lines, again=again)

    def rest(self) -> None:
        """Bring all outputs to rest; see :meth:`put_lines_first`."""
        volts = [0.0] * self._config.analog_outputs
        self.put_lines_first(volts, self.resting_lines, again=True)

    def start_watchdog(self, watchdog: WatchdogOptions) -> None:
        """Start the timer of the card, with the outputs at rest as its expiration states."""
        from nidaqmx.constants import Level, WatchdogAOExpirState
        from nidaqmx.types import AOExpirationState, DOExpirationState

        device = self._config.device
        with self._doing("start the watchdog of"):
            task = self._card.new_watchdog(self._card.name("watchdog"), watchdog.time)
            self._tasks["watchdog"] = task
            lines = zip(self._config.outputs, self.resting_lines, strict=True)
            task.cfg_watchdog_do_expir_states(
                [
                    DOExpirationState(f"{device}/{line}", Level.HIGH if high else Level.LOW)
                    for line, high in lines
                ]
            )
            if watchdog.analog and self._config.analog_outputs:
                task.cfg_watchdog_ao_expir_states(
                    [
                        AOExpirationState(f"{device}/ao{number}", 0.0, WatchdogAOExpirState.VOLTAGE)
                        for number in range(self._config.analog_outputs)
                    ]
                )
            task.start()
            self._watchdog = task

    def feed(self, period_s: float = 0.0) -> None:
        """Reset the timer of the card, if that was not done within ``period_s``."""
        now_s = time.monotonic()
        if now_s - self._fed_s >= period_s:
            with self._doing("feed the watchdog of"):
                self._watchdog.reset_timer()
            self._fed_s = now_s

    def unlock(self) -> None:
        """Let the outputs follow again after the watchdog has expired."""
        with self._doing("unlock"):
            self._watchdog.clear_expiration()

    def end_watchdog(self) -> None:
        """Stop the timer, and let the outputs follow again."""
        self._watchdog = None
        task = self._tasks.pop("watchdog", None)
        if task is None:
            return
        with self._doing("stop the watchdog of"):
            try:
                task.clear_expiration()
            finally:
                task.close()

    def _open_outputs(self) -> None:
        config = self._config
        if config.analog_outputs:
            task = self._new_task("ao")
            task.ao_channels.add_ao_voltage_chan(
                f"{config.device}/ao0:{config.analog_outputs - 1}",
                min_val=-RANGE_V,
                max_val=RANGE_V,
            )
            task.start()
            self._volts_out = _volt_writer(task)
        task = self._new_task("do")
        task.do_channels.add_do_chan(self._names(config.outputs))
        task.start()
        self._lines_out = _line_writer(task)

    def _check_range(self) -> None:
        if not self._config.analog_outputs:
            return
        ends = list(self._card.device().ao_voltage_rngs)
        if not ends:
            raise DeviceError(
                f"{self} has no analogue outputs, expected {self._config.analog_outputs}",
                hint="write `analog_outputs: 0`, or correct `device`",
            )
        if min(ends) > -RANGE_V or max(ends) < RANGE_V:
            raise DeviceError(
                f"the analogue outputs of {self} give {min(ends):g} to {max(ends):g} V, expected "
                f"{-RANGE_V:g} to {RANGE_V:g} V",
                hint="a drive that takes a set value of either sign needs a card that gives it",
            )

    def _add_encoder(self, task: Any, name: str) -> None:
        from nidaqmx.constants import AngleUnits, EncoderType

        task.ci_channels.add_ci_ang_encoder_chan(
            name,
            decoding_type=EncoderType[self._config.decoding.replace("x", "X_")],
            zidx_enable=False,
            units=AngleUnits.TICKS,
        )

    def _terminal(self) -> Any:
        from nidaqmx.constants import TerminalConfiguration

        name = self._config.terminal.name
        return TerminalConfiguration[
            {"DIFFERENTIAL": "DIFF", "PSEUDO_DIFFERENTIAL": "PSEUDO_DIFF"}.get(name, name)
        ]

    def _names(self, lines: Sequence[str]) -> str:
        return ", ".join(f"{self._config.device}/{line}" for line in lines)

    def _new_task(self, of: str) -> Any:
        task = self._tasks[of] = self._card.new_task(self._card.name(of))
        return task

    def _end_task(self, of: str) -> None:
        task = self._tasks.pop(of, None)
        if task is not None:
            task.close()

    def _unlock(self) -> None:
        """Clear an expiration that an earlier process has left."""
        task = self._card.new_watchdog(self._card.name("watchdog"), 1.0)
        try:
            task.clear_expiration()
        finally:
            task.close()

    def _clear_left_over(self) -> None:
        """Clear what a server keeps of a client that was killed; that of one alive is left."""
        of = ("watchdog", "ao", "do", "di", "ai", *(f"ctr{number}" for number in range(8)))
        found = {item: task for item in of if (task := self._card.left_over(self._card.name(item)))}
        if "do" in found and "di" in found and self._is_fed(found["di"]):
            raise LinkError(
                f"the drives on {self} are kept enabled: another rigd on this machine feeds the "
                "one-shot or watchdog, or it no longer falls by itself",
                hint="end that run; if there is none, check the one-shot",
            )
        for task in found.values():
            task.close()

    def _is_fed(self, task: Any) -> bool:
        """Return whether the one-shot or watchdog stays up for longer than its time."""
        guard = self._config.guard
        if guard is None:
            return False
        self._lines_in = _line_reader(task)
        up_at = getattr(guard, "active", "high") == "high"
        for _ in looks(guard.time):
            if self.levels()[guard.input] != up_at:
                return False
            time.sleep(_LOOK_S)
        return True

    def _rescued(self, *, patient: bool) -> bool:
        """Bring the outputs to rest; False: another connection was in between, try again."""
        try:
            with self._card.doing("bring to rest"):
                # What a server keeps of the killed client holds the outputs, and can be driven.
                outputs = {of: self._card.left_over(self._card.name(of)) for of in ("ao", "do")}
                if any(outputs.values()):
                    self._volts_out, self._lines_out = map(_writer_of, outputs.items())
                else:
                    self._open_outputs()
                with suppress(Expired):  # the watchdog did it before
                    self.rest()
            return True
        except DeviceError as error:
            cause = error.__cause__
            if patient and getattr(cause, "error_code", 0) in _CROSSED:
                return False
            raise

    @contextmanager
    def _doing(self, doing: str) -> Iterator[None]:
        """Raise what NI raises as an error of rigd's own; :class:`Expired` by itself."""
        with self._card.doing(doing):
            try:
                yield
            except self._card.errors.DaqError as error:
                if error.error_code not in _EXPIRED:
                    raise
                raise Expired(
                    f"the watchdog of {self} has expired: its outputs stand at rest",
                    hint="this computer or the device server stalled; give `watchdog` more time, "
                    "or see 'rigd doctor'",
                ) from error


def _writer_of(output: tuple[str, Any]) -> Any:
    of, task = output
    if task is None:
        return None
    return _volt_writer(task) if of == "ao" else _line_writer(task)


def _volt_reader(task: Any) -> Any:
    from nidaqmx.stream_readers import AnalogMultiChannelReader

    reader = AnalogMultiChannelReader(task.in_stream)
    reader.verify_array_shape = False  # it would ask the server before every read
    return reader


def _volt_writer(task: Any) -> Any:
    from nidaqmx.stream_writers import AnalogMultiChannelWriter

    writer = AnalogMultiChannelWriter(task.out_stream)
    writer.verify_array_shape = False
    return writer


def _line_reader(task: Any) -> Any:
    from nidaqmx.stream_readers import DigitalSingleChannelReader

    reader = DigitalSingleChannelReader(task.in_stream)
    reader.verify_array_shape = False
    return reader


def _line_writer(task: Any) -> Any:
    from nidaqmx.stream_writers import DigitalSingleChannelWriter

    writer = DigitalSingleChannelWriter(task.out_stream)
    writer.verify_array_shape = False
    return writer
