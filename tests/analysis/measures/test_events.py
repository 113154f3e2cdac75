"""When conditions begin to hold, between samples."""

from __future__ import annotations

import numpy as np
import pytest

from rigd.analysis.measures.events import Samples, event_time, holds_at
from rigd.procedure.program import Comparison, Condition

TIMES = np.arange(0.0, 1.0, 0.1)
ABOVE, BELOW = Comparison.ABOVE, Comparison.BELOW


def samples(name: str) -> Samples:
    values = {
        "ramp": TIMES.copy(),
        "spike": np.where(np.isclose(TIMES, 0.3), 1.0, np.where(TIMES > 0.55, 1.0, 0.0)),
        "down": -TIMES,
        "lost": np.where(np.isclose(TIMES, 0.4), np.nan, TIMES),
        "broken": np.where(np.isclose(TIMES, 0.4), np.inf, TIMES),
        "high": np.ones(10),
    }
    return TIMES, values[name]


def above(channel: str, threshold: float, for_s: float = 0.0) -> Condition:
    return Condition(channel, ABOVE, threshold, for_s=for_s)


@pytest.mark.parametrize(
    ("rows", "at"),
    [
        ([[above("ramp", 0.25)]], 0.25),  # on the line between two samples
        ([[above("ramp", 0.30001)]], 0.30001),
        ([[above("spike", 0.5)]], 0.25),
        ([[above("spike", 0.5, for_s=0.2)]], 0.55),  # the spike is too short
        ([[Condition("down", BELOW, -0.45)]], 0.45),
        ([[Condition("down", ABOVE, 0.45, magnitude=True)]], 0.45),
        ([[above("lost", 0.35)]], 0.5),  # no line leads to a sample that is missing
        ([[above("broken", 0.35)]], 0.5),
        ([[above("broken", 0.45)]], 0.5),
        ([[above("ramp", 0.25), above("spike", 0.5)]], 0.25),
        ([[above("ramp", 0.45), above("spike", 0.5)]], 0.55),  # both must hold
        ([[above("ramp", 0.65)], [above("spike", 0.5, for_s=0.2)]], 0.55),  # either
        ([[above("high", 0.5), above("ramp", 0.25)]], 0.25),
    ],
)
def test_event_is_found_between_samples(rows: list[list[Condition]], at: float) -> None:
    assert event_time(rows, samples, 0.0) == pytest.approx(at, abs=1e-9)


def test_what_never_holds_has_no_time() -> None:
    assert event_time([[above("ramp", 5.0)]], samples, 0.0) is None
    assert event_time([[above("spike", 0.5, for_s=3.0)]], samples, 0.0) is None


def test_what_holds_from_first_sample_has_not_begun() -> None:
    assert event_time([[above("high", 0.5)]], samples, 0.0) is None
    assert holds_at([[above("high", 0.5)]], samples, 0.0)
    assert not holds_at([[above("ramp", 0.25)]], samples, 0.2)


def test_second_event_is_after_the_first() -> None:
    assert event_time([[above("spike", 0.5)]], samples, 0.4) == pytest.approx(0.55)


def strokes(noise: float) -> Samples:
    """Return 10 s of a sine of 1 Hz that begins at its top, with noise, in 5000 samples."""
    times = np.array(np.arange(5000) * 0.002, np.float64)
    scatter = noise * np.random.default_rng(4).standard_normal(len(times))
    return times, np.array(np.cos(2 * np.pi * times) + scatter, np.float64)


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.03])
@pytest.mark.parametrize("number", [1, 2, 7])
def test_numbered_event_counts_no_noise(noise: float, number: int) -> None:
    at = event_time([[above("sine", 0.0)]], lambda _: strokes(noise), 0.0, number)
    assert at == pytest.approx(number - 0.25, abs=max(noise, 1e-3))


def test_event_that_held_begins_again() -> None:
    rows = [[above("sine", 0.5)]]
    assert holds_at(rows, lambda _: strokes(0.0), 0.0)
    assert event_time(rows, lambda _: strokes(0.0), 0.0) == pytest.approx(5 / 6, abs=1e-3)
    assert event_time(rows, lambda _: strokes(0.0), 0.0, 11) is None


@pytest.mark.parametrize("seed", range(20))
def test_noise_about_bound_is_no_event(seed: int) -> None:
    values = np.random.default_rng(seed).standard_normal(20_000)
    values[0] = 1.0
    times = np.array(np.arange(20_000) * 1e-3, np.float64)
    assert event_time([[above("noise", 0.0)]], lambda _: (times, values), 0.0) is None
