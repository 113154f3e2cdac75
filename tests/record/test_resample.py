"""Means around times, and how many rows may repeat an earlier one."""

from __future__ import annotations

import numpy as np
import pytest

from rigd.model.errors import DataError
from rigd.record.read.resample import (
    Times,
    bridge,
    grid,
    means_around,
    on_grid,
    period_ns,
    stale_rows,
)

MS = 1_000_000
CENTRES = 1_700_000_000_000_000_000 + np.arange(100) * MS


def fast(rate_hz: float = 9600.0, *, start_ms: float = -5.0) -> Times:
    offsets = np.arange(round(0.11 * rate_hz)) / rate_hz * 1e9 + start_ms * MS
    times: Times = CENTRES[0] + offsets.astype(np.int64)
    return times


def test_means_are_those_of_the_samples_around() -> None:
    times = fast()
    values = np.random.default_rng(1).normal(size=len(times))
    beside = [np.abs(times - centre) - MS // 2 for centre in CENTRES]
    weights = [np.where(np.abs(item) < 9, 0.5, item < 0) for item in beside]  # by half at an edge
    expected = [np.average(values, weights=item) for item in weights]
    assert means_around(CENTRES, times, values) == pytest.approx(expected, rel=1e-12, abs=1e-15)


def test_means_of_a_line_stay_on_it() -> None:
    """The mean stands where its time is: at most half a sample beside it."""
    times = fast()
    seconds = (times - CENTRES[0]) * 1e-9
    found = means_around(CENTRES, times, 3.0 + 2.0 * seconds)
    assert found == pytest.approx(3.0 + 2.0 * np.arange(100) * 1e-3, abs=2.0 * 0.5 / 9600)


def test_means_of_aligned_samples_have_no_delay() -> None:
    """Where a sample stands at each edge, half of both counts, not the earlier one alone."""
    times = fast(10_000.0)
    found = means_around(CENTRES, times, (times - CENTRES[0]) * 1e-9)
    assert found == pytest.approx(np.arange(100) * 1e-3, abs=1e-9)


def test_a_large_level_keeps_its_digits() -> None:
    times = fast()
    values = 1e9 + np.random.default_rng(1).normal(size=len(times))
    near = means_around(CENTRES, times, values - 1e9)
    assert means_around(CENTRES, times, values) - 1e9 == pytest.approx(near, abs=1e-6)


def test_oscillation_at_the_slow_rate_is_removed() -> None:
    times = fast(10_000.0)
    wave = np.sin(2 * np.pi * 1000.0 * (times - CENTRES[0]) * 1e-9 + 0.3)
    assert np.abs(means_around(CENTRES, times, wave)).max() < 1e-4


@pytest.mark.parametrize("lost", [slice(500, 515), slice(0, 60), slice(-60, None)])
def test_a_gap_is_an_error(lost: slice) -> None:
    times = np.delete(fast(), lost)
    with pytest.raises(DataError, match=r"[0-4] samples .* 0\.\d+ s, .*9\.6"):
        means_around(CENTRES, times, np.ones(len(times)))


def test_mean_accepts_half_a_window_of_samples() -> None:
    """At the ends of a recording, and if a few samples were lost."""
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


def test_single_sample_is_refused_as_a_stream() -> None:
    with pytest.raises(DataError, match="need at least 2"):
        means_around(CENTRES, CENTRES[:1], np.ones(1))
    assert period_ns(CENTRES[:1]) == np.inf


def test_bit_31_marks_a_row_that_repeats() -> None:
    status = np.array([0, 0x8000_0000, 0x7FFF_FFFF, 0xFFFF_FFFF], np.uint32)
    assert stale_rows(status).tolist() == [False, True, False, True]


def test_bridge_over_gap_errs_within_its_bound() -> None:
    """On a parabola it is wrong by a (n + 1)^2 T^2 / 8 at most, n samples being missing."""
    acceleration, keep = 2.0, np.delete(np.arange(1000), range(500, 510))
    times = CENTRES[0] + np.arange(1000) * MS
    values = np.asarray(0.5 * acceleration * (np.arange(1000) * 1e-3) ** 2, np.float64)
    bridged = bridge(times, times[keep], values[keep])
    assert np.array_equal(bridged[keep], values[keep])
    error = np.abs(bridged - values).max()
    assert error == pytest.approx(acceleration * 11e-3**2 / 8, rel=0.01)


@pytest.mark.parametrize("first", [0, 500, 989])
def test_long_gap_is_refused_at_any_place(first: int) -> None:
    times = CENTRES[0] + np.arange(1000) * MS
    kept = np.delete(times, range(first, first + 11))
    with pytest.raises(DataError, match=r"11 samples .*missing"):
        bridge(times, kept, np.ones(len(kept)))


def test_many_short_gaps_are_refused() -> None:
    times = CENTRES[0] + np.arange(1000) * MS
    kept = np.delete(times, range(0, 1000, 40))
    with pytest.raises(DataError, match=r"25 of 1000 samples .* 2 %"):
        bridge(times, kept, np.ones(len(kept)))


def test_grid_fills_gaps_and_keeps_every_time() -> None:
    times = CENTRES[0] + np.delete(np.arange(1000), [3, 4, 500]) * MS
    regular = grid(times)
    assert np.array_equal(regular, CENTRES[0] + np.arange(1000) * MS)
    assert on_grid(regular, times)
    assert not on_grid(regular, times + MS // 2)
    with pytest.raises(DataError, match="a single sample"):
        grid(times[:1])


def test_rate_indivisible_in_ns_stays_on_its_grid() -> None:
    """At 9600 Hz, in ns, steps are 104166 or 104167: what rounding takes must not add up."""
    times = CENTRES[0] + (np.arange(96_000) / 9600.0 * 1e9).astype(np.int64)
    kept = np.delete(times, [1, 2, 50_000])
    regular = grid(kept)
    assert len(regular) == len(times)
    assert np.abs(regular - times).max() <= 2
    assert on_grid(regular, kept)
    values = np.linspace(0.0, 1.0, len(times))
    assert bridge(regular, kept, np.delete(values, [1, 2, 50_000])) == pytest.approx(values)
