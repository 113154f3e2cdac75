"""When rows are recorded is decided by the cycle in times, and looked up when the rows come."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from rigd.engine.cycle.block_rows import PATIENCE_NS, BlockQueue, BlockRecorder, BlockRows
from rigd.engine.play.windows import RecordWindows, Windows
from rigd.model.channels import Channel, Stream
from rigd.model.errors import DeviceError
from rigd.model.rows import row_dtype
from rigd.procedure.program import Capture, Comparison, Condition, Recorded
from rigd.sdk import Block

STREAM = Stream("daq", (Channel("number"),))


def rows(*times_ns: int) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    made = np.zeros(len(times_ns), row_dtype(STREAM))
    made["t_ns"] = times_ns
    return made


def recorder(windows: Windows | None, every: int = 1) -> tuple[BlockRecorder, BlockQueue]:
    queue = BlockQueue(STREAM)
    return BlockRecorder(queue, every, windows), queue


def times(queue: BlockQueue) -> list[int]:
    drained: list[int] = queue.drain()["t_ns"].tolist()
    return drained


def test_window_holds_its_opening_and_not_its_closing() -> None:
    windows = Windows.unshared()
    windows.decide(10, is_open=True)
    windows.decide(20, is_open=True)
    windows.decide(30, is_open=False)
    assert windows.covers(np.array([9, 10, 20, 29, 30, 31])).tolist() == [
        False, True, True, True, False, False,
    ]  # fmt: skip


def test_late_rows_are_judged_by_their_own_time() -> None:
    """Also if two windows have passed since, one of them between two rows of a block."""
    windows = Windows.unshared()
    for t_ns, is_open in ((10, True), (12, False), (13, True), (20, False), (30, False)):
        windows.decide(t_ns, is_open=is_open)
    late, queue = recorder(windows)
    late.take(rows(8, 9, 10, 11))
    late.take(rows(12, 13, 19, 20))
    assert times(queue) == [10, 11, 13, 19]


def test_rows_wait_until_cycle_has_decided_about_them() -> None:
    windows = Windows.unshared()
    windows.decide(10, is_open=False)
    ahead, queue = recorder(windows)
    ahead.take(rows(9, 10, 11, 12))
    ahead.take(rows(13, 14))
    assert times(queue) == []
    windows.decide(12, is_open=True)
    ahead.settle()
    assert times(queue) == [12]
    windows.decide(14, is_open=False)
    ahead.settle()
    assert times(queue) == [13]


def test_rows_waiting_at_end_follow_the_last_decision() -> None:
    windows = Windows.unshared()
    windows.decide(10, is_open=True)
    ahead, queue = recorder(windows)
    ahead.take(rows(9, 11, 12))
    assert times(queue) == []
    ahead.finish()
    assert times(queue) == [11, 12]


def test_rows_do_not_accumulate_while_no_cycle_runs() -> None:
    """Devices stream while others are still being opened."""
    ahead, queue = recorder(Windows.unshared())
    for t_ns in range(0, 100 * PATIENCE_NS, PATIENCE_NS // 10):
        ahead.take(rows(t_ns + 1))
        assert len(ahead._waiting) <= 11
    assert times(queue) == []


def test_every_nth_row_counts_outside_windows_too() -> None:
    windows = Windows.unshared()
    windows.decide(10, is_open=True)
    windows.decide(40, is_open=False)
    third, queue = recorder(windows, 3)
    for start in (0, 16, 32):
        third.take(rows(*range(start, start + 16)))
    assert times(queue) == list(range(12, 40, 3))


def test_each_row_is_recorded_once_for_any_windows() -> None:
    random = np.random.default_rng(3)
    windows = Windows.unshared()
    taken, queue = recorder(windows)
    wanted, given, t_ns = [], 0, 0
    is_open = False
    for t_ns in range(1, 3000):
        if random.random() < 0.2:
            is_open = not is_open
        windows.decide(t_ns, is_open=is_open)
        if is_open:
            wanted.append(t_ns)
        if random.random() < 0.1:  # behind the cycle, or a little ahead of it
            newest = t_ns + int(random.integers(-30, 3))
            taken.take(rows(*range(given + 1, newest + 1)))
            given = max(given, newest)
    taken.take(rows(*range(given + 1, t_ns + 1)))
    assert times(queue) == wanted


def test_rows_arriving_too_late_are_counted_as_lost() -> None:
    windows = Windows.unshared()
    late, _ = recorder(windows)
    for t_ns in range(100):
        windows.decide(t_ns, is_open=t_ns % 2 == 0)
    with pytest.raises(DeviceError, match="more than 31 recording windows late"):
        late.take(rows(1))


def test_window_decision_is_seen_by_other_process() -> None:
    memory = memoryview(bytearray(Windows.BYTES))
    cycle, helper = Windows(memory), Windows(memory)
    assert helper.decided_ns == 0
    cycle.decide(10, is_open=True)
    assert helper.decided_ns == 10
    assert helper.covers(np.array([9, 10])).tolist() == [False, True]


def test_steps_open_windows_of_streams_that_name_them() -> None:
    record = {
        "always": Recorded(),
        "drive": Recorded(1, frozenset({"drive"})),
        "both": Recorded(1, frozenset({"ready", "drive"})),
    }
    shared = Windows.unshared()
    steps = RecordWindows(record, {"both": shared}, {})
    assert steps.of("always") is None
    assert steps.of("both") is shared
    seen = []
    for t_ns, step in enumerate(["", "ready", "drive", "back", ""]):
        steps.decide(t_ns, step, [])
        own = steps.of("drive")
        assert own is not None
        seen.append((own.is_open, shared.is_open))
    assert seen == [(False, False), (False, True), (True, True), (False, False), (False, False)]


@pytest.mark.parametrize(("before", "after"), [(7, 4), (40, 1), (1, 30)])
def test_capture_records_exactly_what_is_around_it(before: int, after: int) -> None:
    random = np.random.default_rng(before)
    when = ((Condition("a.x", Comparison.ABOVE, 0.5),),)
    capture = Capture(when, before * 1e-9, after * 1e-9)
    windows = RecordWindows({"daq": Recorded(capture=capture)}, {}, {"a.x": 0})
    own = windows.of("daq")
    assert own is not None
    taken, queue = recorder(own)
    met: set[int] = set()
    given, changes = 0, list[Mapping[str, object]]()
    for t_ns in range(1, 2001):
        value = float(random.random() < 0.02)
        met |= {t_ns} if value else set()
        changes += windows.decide(t_ns, "", [value])
        if random.random() < 0.1:
            taken.take(rows(*range(given + 1, t_ns + 1)))
            given = t_ns
    taken.take(rows(*range(given + 1, 2001)))
    windows.finish(2000)
    taken.finish()
    wanted = {t for at in met for t in range(max(at - before, 1), min(at + after, 2000) + 1)}
    assert times(queue) == sorted(wanted)
    assert [item["recorded"] for item in changes[:4]] == [True, False, True, False]


def test_every_condition_keeps_its_time_beside_another() -> None:
    above = Comparison.ABOVE
    when = ((Condition("a.x", above, 0.5),), (Condition("b.x", above, 0.5, for_s=10e-9),))
    capture = Capture(when, 2e-9, 2e-9)
    windows = RecordWindows({"daq": Recorded(capture=capture)}, {}, {"a.x": 0, "b.x": 1})
    taken, queue = recorder(windows.of("daq"))
    for t_ns in range(1, 101):
        force, speed = t_ns <= 50, t_ns != 75  # the force falls while the speed lasts
        windows.decide(t_ns, "", [float(force), float(speed)])
    taken.take(rows(*range(1, 101)))
    windows.finish(100)
    taken.finish()
    gap = range(77, 84)  # 2 after the speed was lost, to 2 before it has lasted again
    assert times(queue) == [t for t in range(1, 101) if t not in gap]


def test_blocks_become_rows_with_status_as_word() -> None:
    stream = Stream("daq", (Channel("a"), Channel("b")), has_status=True)
    maker = BlockRows(stream, offset_ns=100)
    made = maker.make(
        Block(np.array([1, 3]), np.array([[1.5, 2.5, 7.0], [3.5, 4.5, 4294967295.0]]))
    )
    assert made.tolist() == [(101, 1.5, 2.5, 7), (103, 3.5, 4.5, 0xFFFFFFFF)]
    with pytest.raises(DeviceError, match="times that do not increase"):
        maker.make(Block(np.array([3]), np.zeros((1, 3))))
    with pytest.raises(DeviceError, match=r"\(1, 2\) .*expected \(1, 3\)"):
        maker.make(Block(np.array([4]), np.zeros((1, 2))))
