"""Times the pulses at a counter of an NI card, and never waits for one.

The counter times each pulse by itself and puts it into a buffer (NI-DAQmx: implicit timing). A read
takes only what is there: a counter read on demand would wait for the next pulse.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from rigd_drivers.cards.card import Train

#: Pulses that the buffer holds: 10 s at 10 kHz.
_BUFFER: Final = 100_000
#: Shortest time to be measured, in s, as is the default of NI-DAQmx.
_SHORTEST_S: Final = 1e-6


class PulseReader:
    """The pulses at one counter since it was opened. ``nidaqmx`` has no types.

    Args:
        task: a new task of NI-DAQmx, which is started.
        counter: name of the counter, such as ``Dev1/ctr0``.
        longest_s: longest period to be timed, in s.
        width: also how long each pulse is high.
    """

    def __init__(self, task: Any, counter: str, *, longest_s: float, width: bool) -> None:
        from nidaqmx.constants import AcquisitionType
        from nidaqmx.stream_readers import CounterReader

        channels = task.ci_channels
        add = channels.add_ci_pulse_chan_time if width else channels.add_ci_period_chan
        add(counter, min_val=_SHORTEST_S, max_val=longest_s)
        task.timing.cfg_implicit_timing(AcquisitionType.CONTINUOUS, _BUFFER)
        task.start()
        self._task = task
        self._width = width
        self._train = Train()
        self._reader = CounterReader(task.in_stream)
        self._reader.verify_array_shape = False

    def take(self, timeout_s: float) -> Train:
        """Return the totals, since the start of the task, of the pulses that have ended by now."""
        count = self._task.in_stream.avail_samp_per_chan
        if not count:
            return self._train
        if self._width:
            highs_s, lows_s = np.zeros(count), np.zeros(count)
            self._reader.read_many_sample_pulse_time(highs_s, lows_s, count, timeout_s)
            high_s, total_s = float(highs_s.sum()), float(highs_s.sum() + lows_s.sum())
        else:
            periods_s = np.zeros(count)
            self._reader.read_many_sample_double(periods_s, count, timeout_s)
            high_s, total_s = 0.0, float(periods_s.sum())
        before = self._train
        self._train = Train(
            before.pulses + count, before.periods_s + total_s, before.high_s + high_s
        )
        return self._train
