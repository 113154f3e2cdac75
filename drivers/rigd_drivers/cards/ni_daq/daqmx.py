"""Runs one NI-DAQmx task that samples analogue inputs, on this machine or behind a gRPC server."""

from __future__ import annotations

import time
from contextlib import suppress
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd.sdk import DeviceError, LinkError
from rigd_drivers.cards.ni_card import NiCard
from rigd_drivers.cards.ni_daq.config import NiDaqConfig, Terminal
from rigd_drivers.wait import looks

#: A task that no client reads from for so long, in s, and so many blocks, has lost its client.
ABANDONED_S: Final = 0.5
_MISSED_BLOCKS: Final = 5
_LOOK_S: Final = 0.02

_TERMINALS: Final = {
    Terminal.DEFAULT: "DEFAULT",
    Terminal.RSE: "RSE",
    Terminal.NRSE: "NRSE",
    Terminal.DIFFERENTIAL: "DIFF",
    Terminal.PSEUDO_DIFFERENTIAL: "PSEUDO_DIFF",
}

# Status codes, as named in nidaqmx.error_codes.DAQmxErrors.
_SAMPLES_NOT_YET_AVAILABLE: Final = -200284
_SAMPLES_NO_LONGER_AVAILABLE: Final = -200279
#: What a rig file can ask for and a card refuse: option -> codes (INVALID_ATTRIBUTE_VALUE,
#: SAMPLE_RATE_NUM_CHANS_CONVERT_PERIOD_COMBO, PHYSICAL_CHAN_DOES_NOT_EXIST).
_REFUSED: Final = {
    -200077: "change `terminal` or `range` of the input, or `rate`, to what the card can do",
    -200081: "lower `rate` or remove inputs: the card has one converter for all of them",
    -200170: "correct `channel` of the input; NI MAX shows which the card has",
}


class Daqmx:
    """One card through NI-DAQmx; errors of NI are raised as rigd's own errors."""

    def __init__(self, config: NiDaqConfig) -> None:
        self._config = config
        self._card = NiCard(config, _REFUSED)
        self._task: Any = None
        self._reader: Any = None

    def open(self) -> str:
        """Find the card, make the task, and return how the card identifies itself.

        Raises:
            LinkError: NI-DAQmx, its server or the card is not there, or another program uses it.
            ProtocolError: it is another card than the rig file names.
            DeviceError: the card cannot do what the rig file asks.
        """
        try:
            identity = self._card.open()
            with self._card.doing("open"):
                self._make_task()
        except BaseException:
            self.close()
            raise
        return identity

    def _make_task(self) -> None:
        from nidaqmx.constants import AcquisitionType, TerminalConfiguration
        from nidaqmx.stream_readers import AnalogMultiChannelReader

        config = self._config
        # A server keeps the task of a client that was killed. Ours is known by its name.
        name = self._card.name()
        self._clear_left_over(name)
        task = self._task = self._card.new_task(name)
        for item in config.inputs:
            task.ai_channels.add_ai_voltage_chan(
                f"{config.device}/{item.channel}",
                terminal_config=TerminalConfiguration[_TERMINALS[item.terminal]],
                min_val=-item.range,
                max_val=item.range,
            )
        task.timing.cfg_samp_clk_timing(
            config.rate,
            sample_mode=AcquisitionType.CONTINUOUS,
            samps_per_chan=config.buffer_samples,
        )
        self._reader = AnalogMultiChannelReader(task.in_stream)
        self._reader.verify_array_shape = False  # it would ask the server before every read

    def _clear_left_over(self, name: str) -> None:
        left_over = self._card.left_over(name)
        if left_over is None:
            return
        if self._is_read(left_over):
            raise LinkError(
                f"{self._card} is in use: another rigd on this machine reads from it",
                hint="end that run first",
            )
        left_over.close()

    def _is_read(self, task: Any) -> bool:
        """Return whether a client fetches samples of ``task``, and so still runs."""
        blocks_s = _MISSED_BLOCKS * self._config.block / self._config.rate
        try:
            began = task.in_stream.curr_read_pos
            late = 1 + round(blocks_s / _LOOK_S)  # the other one may have stood still as we did
            for _ in looks(max(ABANDONED_S, blocks_s), late=late):
                time.sleep(_LOOK_S)
                if task.in_stream.curr_read_pos != began:
                    return True
        except self._card.errors.DaqError:
            return False  # it does not run, or has stopped by itself as its buffer was full
        return False

    def rate_hz(self) -> float:
        """Return the rate that the card makes of the one asked for: a divisor of its crystal's."""
        with self._card.doing("ask for the rate of"):
            return float(self._task.timing.samp_clk_rate)

    def ranges_v(self) -> NDArray[np.float64]:
        """Return lowest and highest voltage of each input's range, shape (inputs, 2)."""
        with self._card.doing("ask for the ranges of"):
            return np.array(
                [
                    (ai_channel.ai_rng_low, ai_channel.ai_rng_high)
                    for ai_channel in self._task.ai_channels
                ],
                np.float64,
            )

    def start(self) -> None:
        """Begin to sample."""
        with self._card.doing("start"):
            self._task.start()

    def read(self, volts: NDArray[np.float64], timeout_s: float) -> NDArray[np.float64]:
        """Wait for samples and return them as a view into ``volts``, shape (inputs, n).

        n is below the width of ``volts`` (inputs, block) only if the time was up before.
        """
        inputs, block = volts.shape
        with self._card.doing("read"):
            try:
                self._reader.read_many_sample(volts, block, timeout_s)
            except self._card.errors.DaqError as error:
                if error.error_code == _SAMPLES_NO_LONGER_AVAILABLE:
                    raise self._overrun(error) from error
                if error.error_code != _SAMPLES_NOT_YET_AVAILABLE:
                    raise
                # NI-DAQmx hands over what it has, packed at the beginning of the array and not in
                # rows as wide as asked for (nidaqmx-python issue 528).
                count = int(error.samps_per_chan_read)
                return volts.ravel()[: inputs * count].reshape(inputs, count)
        return volts

    def _overrun(self, error: Exception) -> DeviceError:
        text = str(error).splitlines()[0]
        return DeviceError(
            f"{self._card} overran: samples were lost because they were not fetched within "
            f"{self._config.buffer:g} s (NI-DAQmx {_SAMPLES_NO_LONGER_AVAILABLE}: {text})",
            hint="make `buffer` or `block` larger, or `rate` smaller; a network that stalls "
            "this long is not fit for it",
        )

    def close(self) -> None:
        """Stop and forget the task; closing twice is silent, and so is closing what is lost.

        :meth:`read` has reported the loss. A task that a server keeps is cleared by the next
        :meth:`open`.
        """
        task, self._task, self._reader = self._task, None, None
        try:
            if task is not None:
                with suppress(self._card.errors.Error):
                    task.close()
        finally:
            self._card.close()
