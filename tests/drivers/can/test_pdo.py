"""PDO set-up, counters that roll over, and what came of one SYNC."""

from __future__ import annotations

import pytest

from rigd.sdk import ProtocolError
from rigd_drivers.can.canopen import objects
from rigd_drivers.can.canopen.counter import Unwrap
from rigd_drivers.can.canopen.inbox import Inbox
from rigd_drivers.can.canopen.pdo import SYNCHRONOUS, Pdo

FEEDBACK = Pdo(1, True, 0x181, SYNCHRONOUS, (objects.STATUSWORD, objects.TORQUE, objects.POSITION))


def test_pdo_is_switched_off_mapped_and_switched_on() -> None:
    # CiA 301, 7.5.2.38: bit 31 of the COB-id while sub-index 0 of the mapping is 0; a mapped
    # object is its index, sub-index and length in bits.
    written = [
        (entry.index, entry.sub, entry.pack(value).hex()) for entry, value in FEEDBACK.setup()
    ]
    assert written == [
        (0x1800, 1, "810100c0"),
        (0x1800, 2, "01"),
        (0x1A00, 0, "00"),
        (0x1A00, 1, "10004160"),
        (0x1A00, 2, "10007760"),
        (0x1A00, 3, "20006460"),
        (0x1A00, 0, "03"),
        (0x1800, 1, "81010040"),
    ]


def test_an_rpdo_has_no_remote_bit() -> None:
    command = Pdo(1, False, 0x202, 1, (objects.CONTROLWORD, objects.TARGET_VELOCITY))
    written = [(entry.index, entry.sub, value) for entry, value in command.setup()]
    assert written[0] == (0x1400, 1, 0x8000_0202)
    assert written[-1] == (0x1400, 1, 0x202)
    assert (0x1600, 2, 0x60FF0020) in written


def test_more_than_a_frame_carries_is_refused() -> None:
    entries = (objects.POSITION, objects.VELOCITY, objects.STATUSWORD)
    with pytest.raises(ValueError, match="10 bytes do not fit"):
        Pdo(1, True, 0x181, 1, entries).layout()


def test_values_are_unpacked_low_byte_first_with_sign() -> None:
    inbox = Inbox(FEEDBACK, 1)
    inbox.receive(bytes.fromhex("37 12 18 FC FF FF FF 7F"))
    assert inbox.take(1) == (0x1237, -1000, 0x7FFF_FFFF)


@pytest.mark.parametrize("bits", [16, 24, 32])
def test_counter_is_followed_over_its_end_both_ways(bits: int) -> None:
    span = 1 << bits
    unwrap = Unwrap(span)
    far = span // 2 - 1  # the largest step that is still seen the right way
    shown = [0, far, 2 * far % span, 3 * far % span, 2 * far % span, far, 0, span - 1]
    assert [unwrap.follow(count) for count in shown] == [
        0, far, 2 * far, 3 * far, 2 * far, far, 0, -1
    ]  # fmt: skip


def test_counter_need_not_be_power_of_two() -> None:
    unwrap = Unwrap(3600 * 4096)
    assert [unwrap.follow(c) for c in (3600 * 4096 - 2, 5, 3600 * 4096 - 1)] == [-2, 5, -1]


def test_counter_begins_at_the_count_it_is_given() -> None:
    unwrap = Unwrap(10_000)
    assert unwrap.begin(9990) == 9990
    assert [unwrap.follow(c) for c in (5, 9985)] == [10_005, 9985]


def test_signed_object_is_followed_like_unsigned_one() -> None:
    unwrap = Unwrap(1 << 32)  # 6064 is unpacked with its sign
    assert [unwrap.follow(c) for c in (2**31 - 1, -(2**31), 2**31 - 2)] == [
        2**31 - 1, 2**31, 2**31 - 2
    ]  # fmt: skip


def test_late_pdo_beside_the_next_is_tolerated() -> None:
    inbox = Inbox(FEEDBACK, 1)
    inbox.receive(bytes(8))
    assert inbox.take(1) is not None
    assert inbox.take(2) is None  # late
    inbox.receive(bytes(8))
    inbox.receive(bytes(8))  # the late one and that of this cycle: no reproach
    assert inbox.take(3) is not None
    for syncs in range(4, 20):
        inbox.receive(bytes(8))
        assert inbox.take(syncs) is not None


def test_twice_per_sync_for_long_means_two_nodes() -> None:
    inbox = Inbox(FEEDBACK, 1)
    with pytest.raises(ProtocolError, match=r"TPDO1 \(0x181\) of node 1 .*often"):
        for syncs in range(1, 30):
            inbox.receive(bytes(8))
            inbox.receive(bytes(8))
            inbox.take(syncs)


def test_answers_long_missing_hide_no_second_node() -> None:
    inbox = Inbox(FEEDBACK, 1)
    syncs = 0
    for lost in (True, False):
        for _ in range(100):  # 100 answers are lost, then all come
            syncs += 1
            if not lost:
                inbox.receive(bytes(8))
            inbox.take(syncs)
    with pytest.raises(ProtocolError, match="often"):
        for _ in range(20):
            syncs += 1
            inbox.receive(bytes(8))
            inbox.receive(bytes(8))
            inbox.take(syncs)


def test_delay_that_ends_is_no_second_node() -> None:
    inbox = Inbox(FEEDBACK, 1)
    for syncs in range(1, 300):
        frames = 1 if syncs > 5 else 0  # five cycles late
        frames += 200 <= syncs < 205  # then no longer: those under way come as well
        for _ in range(frames):
            inbox.receive(bytes(8))
        inbox.take(syncs)


def test_occasional_doubled_frame_is_tolerated() -> None:
    inbox = Inbox(FEEDBACK, 1)
    for syncs in range(1, 200):
        inbox.receive(bytes(8))
        if syncs % 3 == 0:
            inbox.receive(bytes(8))
        assert inbox.take(syncs) is not None


@pytest.mark.parametrize("size", [0, 7])
def test_a_frame_of_another_length_is_refused(size: int) -> None:
    inbox = Inbox(FEEDBACK, 1)
    inbox.receive(bytes(size))
    with pytest.raises(ProtocolError, match=f"has {size} bytes, mapped were 8"):
        inbox.take(1)
