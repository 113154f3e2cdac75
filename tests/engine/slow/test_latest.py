"""The table of latest rows, and the stand-in that the cycle mounts."""

from __future__ import annotations

import math
import mmap
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from support.recordings.blocks import Counter, CounterConfig, device_of, until

from rigd.engine.play.windows import Windows
from rigd.engine.shared import RowRing
from rigd.engine.slow.off_cycle_devices import SlowRows
from rigd.engine.slow.stand_ins import LatestRowProxy
from rigd.engine.slow.table import LatestTable, Slot
from rigd.model.channels import Channel, Stream
from rigd.model.errors import RecordingError

NARROW = Stream("scale", (Channel("mass", "kg"),))
WIDE = Stream("daq", tuple(Channel(f"c{index}") for index in range(20)), has_status=True)


@pytest.fixture
def table(tmp_path: Path) -> LatestTable:
    return LatestTable.create(tmp_path / "latest", [NARROW, WIDE])


def test_row_is_read_as_written_in_another_mapping(table: LatestTable, tmp_path: Path) -> None:
    other = LatestTable.attach(tmp_path / "latest", [NARROW, WIDE])
    assert other.slot("scale").read() is None
    row = [index * 1.5 for index in range(20)] + [float(0xFFFFFFFF)]
    table.slot("daq").write(123_456_789_012_345, row)
    table.slot("scale").write(7, [math.pi])
    assert other.slot("daq").read() == (123_456_789_012_345, row)
    assert other.slot("scale").read() == (7, [math.pi])


def test_each_slot_has_cache_lines_of_its_own(table: LatestTable, tmp_path: Path) -> None:
    table.slot("scale").write(1, [2.0])
    table.slot("daq").write(3, [4.0] * 21)
    data = (tmp_path / "latest").read_bytes()[4096:]
    assert struct.unpack_from("<QQQd", data, 0) == (2, 1, 0, 2.0)
    assert struct.unpack_from("<QQQ21d", data, 64) == (2, 3, 0, *[4.0] * 21)
    assert len(data) == 64 + 192 + 2 * Windows.BYTES


def test_a_row_of_another_width_is_refused(table: LatestTable) -> None:
    with pytest.raises(ValueError, match="the row has 2 values, expected 1"):
        table.slot("scale").write(1, [1.0, 2.0])
    assert table.slot("scale").read() is None


def test_the_table_of_other_streams_is_refused(table: LatestTable, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="another layout"):
        LatestTable.attach(tmp_path / "latest", [WIDE, NARROW])


def test_writer_killed_in_middle_leaves_no_torn_row(table: LatestTable, tmp_path: Path) -> None:
    slot = table.slot("scale")
    slot.write(10, [1.0])
    with (tmp_path / "latest").open("r+b") as file, mmap.mmap(file.fileno(), 0) as memory:
        struct.pack_into("<Q", memory, 4096, 3)  # marked, and never unmarked
    assert slot.read() is None
    slot.write(20, [2.0])  # the next one to have the slot
    assert slot.read() == (20, [2.0])


_WRITER = """
import sys
from rigd.engine.slow.table import LatestTable
from rigd.model.channels import Channel, Stream
stream = Stream("daq", tuple(Channel(f"c{index}") for index in range(20)), has_status=True)
narrow = Stream("scale", (Channel("mass", "kg"),))
slot = LatestTable.attach(sys.argv[1], [narrow, stream]).slot("daq")
number = 0
while True:
    number += 1
    slot.write(number, [float(number)] * 21)
"""


def test_no_row_is_ever_torn(table: LatestTable, tmp_path: Path) -> None:
    """A reader beside a writer in another process sees whole rows, in order."""
    slot = table.slot("daq")
    with subprocess.Popen([sys.executable, "-c", _WRITER, tmp_path / "latest"]) as writer:
        try:
            until(lambda: slot.sequence > 0)
            last, seen = 0, set[int]()
            while len(seen) < 2000:  # it reads while there is writing, however they are scheduled
                assert writer.poll() is None
                found = slot.read()
                if found is None:  # four times in a row while it was being written
                    continue
                t_ns, row = found
                assert row == [float(t_ns)] * 21
                assert t_ns >= last
                last = t_ns
                seen.add(t_ns)
        finally:
            writer.kill()


class Clock:
    """Time for the stand-in, by hand."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.ns = 1_000_000_000
        monkeypatch.setattr("rigd.engine.slow.stand_ins.monotonic_ns", lambda: self.ns)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    return Clock(monkeypatch)


def stand_in(tmp_path: Path) -> tuple[LatestRowProxy, Slot]:
    device = device_of("daq", Counter, CounterConfig())
    slot = LatestTable.create(tmp_path / "own", [device.stream]).slot("daq")
    return LatestRowProxy(device, slot), slot


def test_the_cycle_sees_each_row_once(tmp_path: Path, clock: Clock) -> None:
    latest, slot = stand_in(tmp_path)
    declared = latest.declaration
    assert [channel.name for channel in declared.channels] == ["number", "half"]
    assert (declared.has_status, declared.silent_s, declared.every_cycle) == (True, 0.5, False)
    assert declared.setpoints == ()
    assert latest.read(0) is None
    slot.write(clock.ns - 1, [1.0, 0.5, 3.0])
    assert latest.read(0) == [1.0, 0.5, 3.0]
    assert latest.read(0) is None
    slot.write(clock.ns, [2.0, 1.0, 3.0])
    assert latest.read(0) == [2.0, 1.0, 3.0]


def test_row_already_old_on_arrival_is_no_news(tmp_path: Path, clock: Clock) -> None:
    latest, slot = stand_in(tmp_path)
    slot.write(clock.ns - 500_000_001, [1.0, 0.5, 3.0])
    assert latest.read(0) is None
    slot.write(clock.ns - 500_000_000, [1.0, 0.5, 3.0])
    assert latest.read(0) == [1.0, 0.5, 3.0]


def test_what_an_earlier_run_left_is_no_news(tmp_path: Path, clock: Clock) -> None:
    _, slot = stand_in(tmp_path)
    slot.write(clock.ns, [1.0, 0.5, 3.0])
    assert LatestRowProxy(device_of("daq", Counter, CounterConfig()), slot).read(0) is None


def test_row_age_counts_from_when_it_was_taken(tmp_path: Path, clock: Clock) -> None:
    latest, slot = stand_in(tmp_path)
    slot.write(clock.ns - 12_000_000, [1.0, 0.5, 3.0])
    assert latest.read(5_000_000_000) is not None
    assert latest.taken_ns == 5_000_000_000 - 12_000_000
    slot.write(clock.ns + 1, [2.0, 1.0, 3.0])  # never from the future
    assert latest.read(6_000_000_000) is not None
    assert latest.taken_ns == 6_000_000_000


def test_slow_device_rows_are_recorded_in_open_window(tmp_path: Path) -> None:
    table = LatestTable.create(tmp_path / "windowed", [NARROW])
    cycle = table.windows("scale")
    ring = RowRing.create(tmp_path / "rows", NARROW, 100)
    scale = SlowRows(ring, 2, table.windows("scale"))
    for t_ns in range(1, 40):
        if t_ns % 10 == 0:
            cycle.decide(t_ns, is_open=t_ns == 20)
        scale.push(t_ns, [float(t_ns)])
    assert ring.drain()["mass"].tolist() == [21.0, 23.0, 25.0, 27.0, 29.0]


def test_rare_rows_count_after_many_windows(tmp_path: Path) -> None:
    """Between two rows of a slow device that are recorded, a hundred steps may have passed."""
    table = LatestTable.create(tmp_path / "windowed", [NARROW])
    cycle = table.windows("scale")
    ring = RowRing.create(tmp_path / "rows", NARROW, 100)
    scale = SlowRows(ring, 1, table.windows("scale"))
    for t_ns in range(1, 1001):
        cycle.decide(t_ns, is_open=t_ns % 10 < 5)
        if t_ns in (3, 498, 992):
            scale.push(t_ns, [float(t_ns)])
    assert ring.drain()["mass"].tolist() == [3.0, 992.0]
