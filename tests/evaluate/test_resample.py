"""Means around times, and how many rows may repeat an earlier one."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.evaluate.resample import Times, check_stale, means_around, period_ns, stale_rows
from rigd.model.errors import DataError

MS = 1_000_000
CENTRES = 1_700_000_000_000_000_000 + np.arange(100) * MS


def fast(rate_hz: float = 9600.0, *, start_ms: float = -5.0) -> Times:
    offsets = np.arange(round(0.11 * rate_hz)) / rate_hz * 1e9 + start_ms * MS
    times: Times = CENTRES[0] + offsets.astype(np.int64)
    return times


def test_means_are_those_of_the_samples_around() -> None:
    times = fast()
    values = np.random.default_rng(1).normal(size=len(times))
    expected = [
        values[(times >= centre - MS // 2) & (times < centre + MS // 2)].mean()
        for centre in CENTRES
    ]
    assert means_around(CENTRES, times, values) == pytest.approx(expected, rel=1e-12, abs=1e-15)


def test_a_line_comes_out_as_itself() -> None:
    """The mean stands where its time is: at most half a sample beside it."""
    times = fast()
    seconds = (times - CENTRES[0]) * 1e-9
    found = means_around(CENTRES, times, 3.0 + 2.0 * seconds)
    assert found == pytest.approx(3.0 + 2.0 * np.arange(100) * 1e-3, abs=2.0 * 0.5 / 9600)


def test_a_large_level_keeps_its_digits() -> None:
    times = fast()
    values = 1e9 + np.random.default_rng(1).normal(size=len(times))
    near = means_around(CENTRES, times, values - 1e9)
    assert means_around(CENTRES, times, values) - 1e9 == pytest.approx(near, abs=1e-6)


def test_what_oscillates_at_the_slow_rate_is_gone() -> None:
    times = fast(10_000.0)
    wave = np.sin(2 * np.pi * 1000.0 * (times - CENTRES[0]) * 1e-9 + 0.3)
    assert np.abs(means_around(CENTRES, times, wave)).max() < 1e-4


@pytest.mark.parametrize("lost", [slice(500, 515), slice(0, 60), slice(-60, None)])
def test_a_gap_is_an_error(lost: slice) -> None:
    times = np.delete(fast(), lost)
    with pytest.raises(DataError, match=r"[0-4] samples stand around 0\.\d+ s, where 9\.6 are"):
        means_around(CENTRES, times, np.ones(len(times)))


def test_half_a_window_is_enough() -> None:
    """At the ends of a recording, and where a few samples were lost."""
    times = fast(start_ms=0.0)
    assert np.array_equal(means_around(CENTRES, times, np.ones(len(times))), np.ones(100))


@pytest.mark.parametrize(("rate_hz", "fits"), [(500.0, False), (1000.0, False), (2000.0, True)])
def test_slower_and_equal_streams_are_not_averaged(rate_hz: float, fits: bool) -> None:
    times = fast(rate_hz)
    if fits:
        means_around(CENTRES, times, np.ones(len(times)))
        return
    with pytest.raises(DataError, match="need at least 2 in every 1 ms"):
        means_around(CENTRES, times, np.ones(len(times)))


def test_one_sample_is_no_stream() -> None:
    with pytest.raises(DataError, match="need at least 2"):
        means_around(CENTRES, CENTRES[:1], np.ones(1))
    assert period_ns(CENTRES[:1]) == np.inf


def test_bit_31_marks_a_row_that_repeats() -> None:
    status = np.array([0, 0x8000_0000, 0x7FFF_FFFF, 0xFFFF_FFFF], np.uint32)
    assert stale_rows(status).tolist() == [False, True, False, True]


def flags(count: int, *stale: int) -> NDArray[np.bool_]:
    found = np.zeros(count, np.bool_)
    found[list(stale)] = True
    return found


def test_a_few_late_rows_are_taken() -> None:
    check_stale(flags(0))
    check_stale(flags(1000))
    check_stale(flags(1000, 0, 500, 501, 502, 999))


def test_more_are_refused() -> None:
    with pytest.raises(DataError, match=r"6 of 1000 rows \(0\.6 %\) .* at most 0\.5 %"):
        check_stale(flags(1000, 0, 100, 200, 300, 400, 999))


@pytest.mark.parametrize("first", [0, 500, 996])
def test_so_are_many_in_succession(first: int) -> None:
    with pytest.raises(DataError, match="4 rows in succession"):
        check_stale(flags(1000, *range(first, first + 4)))
