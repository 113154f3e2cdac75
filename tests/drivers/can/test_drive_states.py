"""Drive states against the tables of CiA 402-2, and the way through them."""

from __future__ import annotations

import itertools

import pytest

from rigd_drivers.can.canopen.cia402 import DriveState, Enabling, state_of


@pytest.mark.parametrize(
    ("statusword", "state"),
    [
        # CiA 402-2, table of the state coding: xxxx xxxx x0xx 0000 and so on, x as 0 and as 1.
        (0b0000_0000_0000_0000, DriveState.NOT_READY),
        (0b1111_1111_1011_0000, DriveState.NOT_READY),
        (0b0000_0000_0100_0000, DriveState.SWITCH_ON_DISABLED),
        (0b1111_1111_1111_0000, DriveState.SWITCH_ON_DISABLED),
        (0b0000_0000_0010_0001, DriveState.READY),
        (0b1111_1111_1011_0001, DriveState.READY),
        (0b0000_0000_0010_0011, DriveState.SWITCHED_ON),
        (0b0000_0000_0010_0111, DriveState.ENABLED),
        (0b1111_1111_1011_0111, DriveState.ENABLED),
        (0b0000_0000_0000_0111, DriveState.QUICK_STOP),
        (0b1111_1111_1001_0111, DriveState.QUICK_STOP),
        (0b0000_0000_0000_1111, DriveState.FAULT_REACTION),
        (0b1111_1111_1011_1111, DriveState.FAULT_REACTION),
        (0b0000_0000_0000_1000, DriveState.FAULT),
        (0b1111_1111_1011_1000, DriveState.FAULT),
        (0b0000_0000_0000_0010, DriveState.UNKNOWN),
    ],
)
def test_status_word_decodes_to_drive_state(statusword: int, state: DriveState) -> None:
    assert state_of(statusword) is state


def test_operation_enabled_needs_transitions_2_3_4() -> None:
    enabling = Enabling()
    words = [enabling.next(word) for word in (0x0250, 0x0231, 0x0233, 0x1237)]
    assert words == [0x06, 0x07, 0x0F, 0x0F]


def test_unready_or_faulting_drive_gets_no_command() -> None:
    enabling = Enabling()
    assert [enabling.next(word) for word in (0x0000, 0x001F, 0x0017)] == [0, 0, 0]


def test_fault_is_reset_by_repeated_rising_edges() -> None:
    enabling = Enabling()
    words = [enabling.next(0x0218) for _ in range(4 * Enabling.HOLD)]
    rises = sum(new == 0x80 and old == 0x00 for old, new in itertools.pairwise(words))
    assert words[0] == 0x00  # low first, so that there is an edge
    assert rises == 2
    assert set(words) == {0x00, 0x80}
    assert enabling.next(0x0250) == 0x06
