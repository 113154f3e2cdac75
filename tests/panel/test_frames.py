"""Frames that wait are merged without losing an extreme, and never grow beyond their bound."""

from __future__ import annotations

import json

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rigd.panel.messages import LiveLink, PageEvent, RigLink
from rigd.panel.outbox import BATCH_S, MOST_EVENTS, MOST_POINTS, MOST_UNDER_WAY, Outbox, merge
from rigd.remote.protocol import VERSION, Frame, decode_frame


def a_frame(points: int, t0_ns: int = 0, channels: int = 2, seed: int = 0) -> Frame:
    values = np.random.default_rng(seed).normal(size=(channels, points)).astype("f4")
    return Frame(3, 0, t0_ns, np.arange(points, dtype=np.float64) * 1e-3, values - 1, values + 1)


@settings(max_examples=60)
@given(
    st.lists(st.integers(1, 90), min_size=2, max_size=12),
    st.integers(2, 50),
)
def test_no_extreme_is_lost(sizes: list[int], most: int) -> None:
    frames = [a_frame(size, 10**9 * n, seed=n) for n, size in enumerate(sizes)]
    merged = frames[0]
    for frame in frames[1:]:
        merged = merge(merged, frame, most)

    assert merged.time_s.size <= most
    assert np.all(np.diff(merged.time_s) > 0)
    lows = np.concatenate([item.low for item in frames], axis=1)
    highs = np.concatenate([item.high for item in frames], axis=1)
    np.testing.assert_array_equal(merged.low.min(axis=1), lows.min(axis=1))
    np.testing.assert_array_equal(merged.high.max(axis=1), highs.max(axis=1))


def test_times_are_those_of_the_first_frame() -> None:
    merged = merge(a_frame(2, 5 * 10**9), a_frame(2, 6 * 10**9), 10)
    assert merged.t0_ns == 5 * 10**9
    np.testing.assert_allclose(merged.time_s, [0, 1e-3, 1.0, 1.001])


def test_clock_that_was_set_back_breaks_no_bound() -> None:
    assert merge(a_frame(9, 10**12), a_frame(9, 0), 8).time_s.size <= 8


def test_empty_interval_does_not_hide_merged_values() -> None:
    first, second = a_frame(1), a_frame(1, 10**6, seed=1)
    first.low[0, 0] = first.high[0, 0] = np.nan
    merged = merge(first, second, 1)
    assert merged.low[0, 0] == second.low[0, 0]


def test_frames_of_another_run_take_place_of_old() -> None:
    second = a_frame(4, channels=3)
    assert merge(a_frame(4, channels=2), second, 10) is second


async def next_of(outbox: Outbox) -> list[str | bytes]:
    return await outbox.take()


def run_take(outbox: Outbox) -> list[str | bytes]:
    import asyncio

    return asyncio.run(next_of(outbox))


def link(silent_s: float = 0.0) -> LiveLink:
    return LiveLink(panel=RigLink(alive=True, silent_s=silent_s))


class Clock:
    """A clock that a test sets."""

    def __init__(self) -> None:
        self.s = 0.0

    def __call__(self) -> float:
        return self.s


def test_browser_gets_points_it_can_show() -> None:
    clock = Clock()
    outbox = Outbox(clock)
    outbox.points_per_s = 50.0
    frames = [a_frame(33, n * 33_000_000, seed=n) for n in range(30)]
    batches = []
    for frame in frames:  # 1000 rows in a second, in 30 frames
        outbox.frame(frame)
        outbox.put(link())
        batches += [item for item in run_take(outbox) if isinstance(item, bytes)]
        outbox.drawn()
        clock.s += 1 / 30
    sent = [decode_frame(item) for item in batches]
    assert 0.9 / BATCH_S - 2 <= len(sent) <= 1 / BATCH_S + 1, "no more batches than can be read"
    assert sum(item.time_s.size for item in sent) <= 50 + len(sent)
    kept = frames[: round(30 * (sent[-1].t0_ns * 1e-9 + sent[-1].time_s[-1])) + 1]
    for channel in range(2):
        assert max(item.high[channel].max() for item in sent) == max(
            item.high[channel].max() for item in kept
        )


def test_idle_browser_gets_two_batches_then_one_complete() -> None:
    clock = Clock()
    outbox = Outbox(clock)
    for n in range(MOST_UNDER_WAY):
        outbox.frame(a_frame(33, n * 33_000_000, seed=n))
        assert len(run_take(outbox)) == 1
        clock.s += BATCH_S
    for n in range(100):
        outbox.frame(a_frame(33, (2 + n) * 33_000_000, seed=n))
    outbox.put(link())
    assert [type(item) for item in run_take(outbox)] == [str], "no frame while two are under way"

    outbox.drawn()
    (batch,) = run_take(outbox)
    assert isinstance(batch, bytes)
    frame = decode_frame(batch)
    assert frame.time_s.size <= MOST_POINTS
    assert frame.time_s[-1] > 3.0, "it reaches to the newest"
    assert np.diff(frame.time_s).max() < 0.1, "the oldest are no coarser than the bound asks for"


def test_only_the_newest_of_a_kind_waits() -> None:
    outbox = Outbox()
    for n in range(1000):
        outbox.put(link(float(n)))
    assert run_take(outbox) == ['{"kind":"panel","panel":{"alive":true,"silent_s":999.0}}']


def test_events_wait_within_bound_and_omissions_are_counted() -> None:
    outbox = Outbox()
    for n in range(MOST_EVENTS + 7):
        outbox.event(PageEvent(v=VERSION, seq=n, t_ns=1, kind="limit"))
    ready = run_take(outbox)
    assert ready[0] == '{"kind":"skipped","skipped":7}'
    assert len(ready) == 1 + MOST_EVENTS
    assert json.loads(ready[1])["event"]["seq"] == 7
