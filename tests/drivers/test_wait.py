"""A device is looked at for as long as it is given, and once more behind a stall."""

from __future__ import annotations

import pytest
from support.faults.stalls import STALL_S, standing_still

from rigd_drivers.wait import looks


def test_looks_end_once_their_time_is_over() -> None:
    left = list(looks(0.01))
    assert left == sorted(left, reverse=True)
    assert 0 < left[0] <= 0.01
    assert [each for each in left if each == 0] == [0]


@pytest.mark.parametrize("late", [1, 3])
def test_looks_begin_behind_a_stall(monkeypatch: pytest.MonkeyPatch, late: int) -> None:
    stall = standing_still(monkeypatch)
    given = looks(STALL_S, late=late)
    assert next(given) > 0
    stall()
    assert list(given) == [0] * late
