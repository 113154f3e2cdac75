"""What the profiles claim: shape, continuity of phase, balance, no slot played twice."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from rigd.procedure.profiles.profiles import (
    TAPS,
    Chirp,
    ConstantProfile,
    Prbs,
    Ramp,
    Sine,
    Square,
    TableProfile,
)


def test_constant_and_ramp_give_values_over_time() -> None:
    assert ConstantProfile(2.0).at(5.0, 1.0) == 2.0
    ramp = Ramp(None, 3.0, 2.0)
    assert [ramp.at(t, 1.0) for t in (0.0, 1.0, 2.0, 9.0)] == [1.0, 2.0, 3.0, 3.0]
    assert Ramp(-1.0, 1.0, 4.0).at(1.0, 99.0) == pytest.approx(-0.5)


def test_sine_starts_at_its_phase() -> None:
    sine = Sine(2.0, 5.0, offset=1.0, phase_rad=math.pi / 2)
    assert sine.at(0.0, 0.0) == pytest.approx(3.0)
    assert sine.at(0.1, 0.0) == pytest.approx(-1.0)


@pytest.mark.parametrize("logarithmic", [False, True])
@pytest.mark.parametrize(("start", "end"), [(1.0, 20.0), (20.0, 1.0), (5.0, 5.0)])
def test_chirp_has_frequencies_it_claims_and_no_jump(
    logarithmic: bool, start: float, end: float
) -> None:
    chirp = Chirp(1.0, start, end, 2.0, logarithmic=logarithmic)
    step = 1e-4
    values = [chirp.at(n * step, 0.0) for n in range(round(3.0 / step))]
    fastest = 2 * math.pi * max(start, end) * step
    assert max(abs(b - a) for a, b in pairwise(values)) <= fastest * 1.001
    # Rising zero crossings count cycles: the integral of the frequency, end frequency held after.
    cycles = sum(a < 0 <= b for a, b in pairwise(values))
    if logarithmic and start != end:
        expected = 2.0 * (end - start) / math.log(end / start) + end
    else:
        expected = 2.0 * (start + end) / 2 + end
    assert cycles == pytest.approx(expected, abs=1.5)


@pytest.mark.parametrize("order", TAPS)
def test_prbs_is_of_maximum_length(order: int) -> None:
    period = 2**order - 1
    prbs = Prbs(1.0, 1.0, order)
    bits = [prbs.at(n, 0.0) > 0 for n in range(period + order)]
    windows = {tuple(bits[n : n + order]) for n in range(period)}
    assert len(windows) == period  # every non-zero state of the register exactly once
    assert sum(bits[:period]) == 2 ** (order - 1)  # balanced: one more high than low
    assert bits[period:] == bits[:order]


def test_prbs_autocorrelation_is_flat() -> None:
    period = 2**9 - 1
    values = [Prbs(1.0, 1.0, 9).at(n, 0.0) for n in range(period)]
    for lag in (1, 2, 7, 100, 255):
        products = sum(values[n] * values[(n + lag) % period] for n in range(period))
        assert products == -1


def test_prbs_seeds_shift_one_sequence() -> None:
    found = [Prbs(1.0, 1.0, 5, seed=1).at(n, 0.0) for n in range(31)]
    other = [Prbs(1.0, 1.0, 5, seed=7).at(n, 0.0) for n in range(31)]
    assert found != other
    assert any(found[k:] + found[:k] == other for k in range(31))


@pytest.mark.parametrize("bit_ms", [1, 3, 7, 10, 20, 30, 70])
def test_every_bit_lasts_equally_many_cycles(bit_ms: int) -> None:
    """0.3 / 0.1 is 2.999...: truncation would play some bits a cycle too long."""
    prbs = Prbs(1.0, bit_ms * 1e-3, 7)
    for origin_ms in (0, 1_000_000):
        for slot in range(300):
            begin = origin_ms // bit_ms * bit_ms + slot * bit_ms
            values = {prbs.at((begin + ms) * 1e-3, 0.0) for ms in range(bit_ms)}
            assert len(values) == 1


def test_square_halves_are_equally_long() -> None:
    square = Square(1.5, 5.0, offset=0.5)
    values = [square.at(ms * 1e-3, 0.0) for ms in range(1000)]
    assert values == ([2.0] * 100 + [-1.0] * 100) * 5


def test_table_joins_or_holds() -> None:
    lines = TableProfile((0.0, 1.0, 3.0), (0.0, 2.0, -2.0))
    assert [lines.at(t, 9.0) for t in (0.0, 0.5, 1.0, 2.0, 3.0, 9.0)] == [0, 1, 2, 0, -2, -2]
    held = TableProfile((0.0, 0.1, 0.3), (0.0, 2.0, -2.0), hold=True)
    assert [held.at(ms * 1e-3, 9.0) for ms in (0, 99, 100, 299, 300)] == [0, 0, 2, 2, -2]
    assert held.at(0.1 * 3, 9.0) == -2  # 0.30000000000000004
    assert held.at(0.3 - 1e-16, 9.0) == -2
