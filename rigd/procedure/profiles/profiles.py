"""Computes setpoints over time (profiles): constant, ramp, sine, square, chirp, PRBS, table."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

#: A time may be before a slot by this part of it and still belong to it. Slot times are sums and
#: quotients of decimal fractions, 0.3 / 0.1 = 2.999...: truncating would repeat a slot.
_SLOT_ROUNDING = 1e-6


#: The same for the times of a table: far below a cycle, far above the rounding error of a day in s.
_TIME_ROUNDING_S = 1e-9


def slot(t_s: float, width_s: float) -> int:
    """Return the number of the slot of ``width_s`` with ``t_s``; a slot includes its start."""
    return math.floor(t_s / width_s + _SLOT_ROUNDING)


@dataclass(frozen=True)
class ConstantProfile:
    """A constant value."""

    value: float

    def at(self, t_s: float, initial: float) -> float:
        """Return the setpoint at ``t_s`` in the segment; ``initial`` is the value before it."""
        return self.value


@dataclass(frozen=True)
class Ramp:
    """A line from ``start`` (None: the value before) to ``end`` in ``duration_s``, then held."""

    start: float | None
    end: float
    duration_s: float

    def at(self, t_s: float, initial: float) -> float:
        """Return the setpoint at ``t_s`` in the segment; ``initial`` is the value before it."""
        start = initial if self.start is None else self.start
        if t_s >= self.duration_s:
            return self.end
        return start + (self.end - start) * t_s / self.duration_s


@dataclass(frozen=True)
class Sine:
    """``offset + amplitude sin(2 pi frequency t + phase)``.

    With ``fade_s`` the amplitude falls linearly to zero within that time.
    """

    amplitude: float
    frequency_hz: float
    offset: float = 0.0
    phase_rad: float = 0.0
    fade_s: float = math.inf

    def at(self, t_s: float, initial: float) -> float:
        """Return the setpoint at ``t_s`` in the segment; ``initial`` is the value before it."""
        angle = 2 * math.pi * self.frequency_hz * t_s + self.phase_rad
        amplitude = self.amplitude * max(0.0, 1.0 - t_s / self.fade_s)
        return self.offset + amplitude * math.sin(angle)


@dataclass(frozen=True)
class Square:
    """``offset + amplitude`` for the first half of each period, ``offset - amplitude`` after it."""

    amplitude: float
    frequency_hz: float
    offset: float = 0.0

    def at(self, t_s: float, initial: float) -> float:
        """Return the setpoint at ``t_s`` in the segment; ``initial`` is the value before it."""
        is_second_half = slot(t_s, 0.5 / self.frequency_hz) % 2
        return self.offset - self.amplitude if is_second_half else self.offset + self.amplitude


@dataclass(frozen=True)
class Chirp:
    """Sine whose frequency goes from ``start_hz`` to ``end_hz`` in ``duration_s``.

    Linear in time or, with ``logarithmic``, by a constant factor per second; the end frequency is
    held after. The phase is continuous throughout.
    """

    amplitude: float
    start_hz: float
    end_hz: float
    duration_s: float
    offset: float = 0.0
    logarithmic: bool = False

    def at(self, t_s: float, initial: float) -> float:
        """Return the setpoint at ``t_s`` in the segment; ``initial`` is the value before it."""
        inside = min(t_s, self.duration_s)
        if self.logarithmic and self.end_hz != self.start_hz:
            rate = math.log(self.end_hz / self.start_hz) / self.duration_s
            cycles = self.start_hz * math.expm1(rate * inside) / rate
        else:
            slope = (self.end_hz - self.start_hz) / self.duration_s
            cycles = self.start_hz * inside + slope * inside * inside / 2
        cycles += self.end_hz * (t_s - inside)
        return self.offset + self.amplitude * math.sin(2 * math.pi * cycles)


#: Feedback taps of maximum-length shift registers (Xilinx XAPP052, table 3).
TAPS = {5: (5, 3), 7: (7, 6), 9: (9, 5), 10: (10, 7), 11: (11, 9), 15: (15, 14)}


@dataclass(frozen=True)
class Prbs:
    """Maximum-length pseudo-random binary sequence of ``order`` bits: ``offset ± amplitude``.

    Repeats after ``2**order - 1`` bits of ``bit_s`` each; ``seed`` selects the start.
    """

    amplitude: float
    bit_s: float
    order: int = 9
    offset: float = 0.0
    seed: int = 1

    def at(self, t_s: float, initial: float) -> float:
        """Return the setpoint at ``t_s`` in the segment; ``initial`` is the value before it."""
        bits = _prbs(self.order, self.seed)
        bit = bits[slot(t_s, self.bit_s) % len(bits)]
        return self.offset + (self.amplitude if bit else -self.amplitude)


_PRBS_CACHE: dict[tuple[int, int], tuple[int, ...]] = {}


def _prbs(order: int, seed: int) -> tuple[int, ...]:
    """Return one period of the sequence of a Fibonacci shift register."""
    key = (order, seed)
    if key not in _PRBS_CACHE:
        first, second = TAPS[order]
        period = 2**order - 1
        register = 1 + seed % period  # never zero, the state that the register cannot leave
        bits = []
        for _ in range(period):
            bit = ((register >> (first - 1)) ^ (register >> (second - 1))) & 1
            register = ((register << 1) | bit) & period
            bits.append(bit)
        _PRBS_CACHE[key] = tuple(bits)
    return _PRBS_CACHE[key]


@dataclass(frozen=True)
class TableProfile:
    """Values at times, joined by straight lines (or held, with ``hold``); the last value stays.

    ``times_s`` rises strictly and begins with 0.
    """

    times_s: tuple[float, ...]
    values: tuple[float, ...]
    hold: bool = False

    def at(self, t_s: float, initial: float) -> float:
        """Return the setpoint at ``t_s`` in the segment; ``initial`` is the value before it."""
        behind = bisect_right(self.times_s, t_s + _TIME_ROUNDING_S)
        if behind == 0:
            return self.values[0]
        if behind == len(self.times_s) or self.hold:
            return self.values[behind - 1]
        t0, t1 = self.times_s[behind - 1], self.times_s[behind]
        v0, v1 = self.values[behind - 1], self.values[behind]
        return v0 + (v1 - v0) * (t_s - t0) / (t1 - t0)


Profile = ConstantProfile | Ramp | Sine | Square | Chirp | Prbs | TableProfile
