"""Switches the relay and triggers its one-shot through digital lines of an NI card.

The module also reads the output of the one-shot. ``nidaqmx`` ships no types, so its values are
``Any``.
"""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any, Final

import numpy as np

from rigd.sdk import LinkError
from rigd_drivers.cards.ni_card import NiCard
from rigd_drivers.cards.ni_relay.config import NiRelayConfig
from rigd_drivers.wait import looks

#: Longest answer of a device server, in s: the relay must not hang on one that is away.
CALL_S: Final = 0.5
#: What a rig file can ask for and a card refuse: PHYSICAL_CHAN_DOES_NOT_EXIST,
#: DIGITAL_OUTPUT_NOT_SUPPORTED, DIGITAL_INPUT_NOT_SUPPORTED.
_REFUSED: Final = {
    code: "correct `line` or `feedback`; NI MAX shows which lines the card has"
    for code in (-200170, -200012, -200011)
}
_LOOK_S: Final = 0.02


class RelayLines:
    """Relay and one-shot on the lines of one card; calls wait for the card.

    Until :meth:`open` all is at rest: nothing is driven. For one thread at a time.
    """

    def __init__(self, config: NiRelayConfig) -> None:
        self._config = config
        self._card = NiCard(config, _REFUSED, call_s=lambda: CALL_S)
        self._closed_high = config.active == "high"
        watchdog = config.watchdog
        outputs = (config.line,) if watchdog is None else (config.line, watchdog.line)
        self._outputs = ", ".join(f"{config.device}/{line}" for line in outputs)
        self._levels = np.zeros(len(outputs), dtype=bool)
        self._level = np.zeros(1, dtype=bool)
        self._tasks: list[Any] = []
        self._writer: Any = None
        self._reader: Any = None

    def open(self) -> str:
        """Take the lines, open the relay, and return how the card identifies itself.

        Raises:
            LinkError: NI-DAQmx, its server or the card is not there, or another program uses
                the lines.
            ProtocolError: it is another card than the rig file names.
            DeviceError: the card does not have these lines.
        """
        try:
            identity = self._card.open()
            self._take_lines()
            self.put(closed=False, trigger=False)
        except BaseException:
            self.close()
            raise
        return identity

    def _take_lines(self) -> None:
        with self._card.doing("take lines of"):
            self._clear_left_over()
            output = self._new_task(self._output_name)
            output.do_channels.add_do_chan(self._outputs)
            output.start()
            self._write_to(output)
            if self._config.watchdog is not None:
                inputs = self._new_task(self._input_name)
                inputs.di_channels.add_di_chan(self._feedback)
                inputs.start()
                self._read_from(inputs)

    def put(self, *, closed: bool, trigger: bool) -> None:
        """Put out both lines at once: whether the relay closes, and the level of the trigger.

        Raises:
            LinkError: the device server does not answer.
            DeviceError: the card is gone.
        """
        self._levels[0] = closed == self._closed_high
        self._levels[1:] = trigger
        with self._card.doing("switch a line of"):
            self._writer.write_one_sample_multi_line(self._levels)

    def one_shot_up(self) -> bool:
        """Return whether the one-shot is up; see :meth:`put`. True without a one-shot."""
        watchdog = self._config.watchdog
        if watchdog is None:
            return True
        with self._card.doing("read a line of"):
            self._reader.read_one_sample_multi_line(self._level)
        return bool(self._level[0]) == (watchdog.active == "high")

    def rescue(self) -> None:
        """Open the relay over a connection of its own, even if another process left it closed.

        Raises:
            LinkError: the card cannot be reached, or another program has the line.
        """
        self._card.connect()
        try:
            with self._card.doing("take lines of"):
                # What a server keeps of the killed client holds the lines, and can be driven.
                task = self._card.left_over(self._output_name)
                if task is None:
                    task = self._card.new_task(self._output_name)
                    task.do_channels.add_do_chan(self._outputs)
                self._tasks.append(task)
                self._write_to(task)
            self.put(closed=False, trigger=False)
        finally:
            self.close()

    def close(self) -> None:
        """Release the lines, which keep their levels; closing twice is silent."""
        tasks, self._tasks = self._tasks, []
        self._writer = self._reader = None
        try:
            for task in tasks:
                with suppress(self._card.errors.Error):
                    task.close()
        finally:
            self._card.close()

    @property
    def _output_name(self) -> str:
        return self._card.name(self._config.line)

    @property
    def _input_name(self) -> str:
        return self._card.name(self._config.line, "feedback")

    @property
    def _feedback(self) -> str:
        watchdog = self._config.watchdog
        return "" if watchdog is None else f"{self._config.device}/{watchdog.feedback}"

    def _new_task(self, name: str) -> Any:
        task = self._card.new_task(name)
        self._tasks.append(task)
        return task

    def _write_to(self, task: Any) -> None:
        from nidaqmx.stream_writers import DigitalSingleChannelWriter

        self._writer = DigitalSingleChannelWriter(task.out_stream)
        self._writer.verify_array_shape = False  # it would ask the server before every write

    def _read_from(self, task: Any) -> None:
        from nidaqmx.stream_readers import DigitalSingleChannelReader

        self._reader = DigitalSingleChannelReader(task.in_stream)
        self._reader.verify_array_shape = False

    def _clear_left_over(self) -> None:
        """Clear what a server keeps of a client that was killed; that of one alive is left."""
        names = (self._output_name, self._input_name)
        left_over = {name: task for name in names if (task := self._card.left_over(name))}
        if self._input_name in left_over and self._is_fed(left_over[self._input_name]):
            raise LinkError(
                f"the one-shot of the relay on {self._config.line} of {self._card} stays up: "
                "another rigd on this machine feeds it, or it no longer falls by itself",
                hint="end that run; if there is none, check the one-shot",
            )
        for task in left_over.values():
            task.close()

    def _is_fed(self, task: Any) -> bool:
        """Return whether the one-shot stays up for longer than its time: it is fed, or defect."""
        watchdog = self._config.watchdog
        if watchdog is None:
            return False
        self._read_from(task)
        for _ in looks(watchdog.time):
            if not self.one_shot_up():
                return False
            time.sleep(_LOOK_S)
        return True
