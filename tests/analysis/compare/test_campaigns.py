"""Campaigns on rigs at random: 5 % are found, equal ones are not told apart.

`benchmarks/compare.py` is the whole study.
"""

from __future__ import annotations

import pytest
from support.recordings.comparing import CHANGE, Try, tries


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> list[Try]:
    currents = "{from: 0.3 A, to: 1.5 A, step: 0.3 A}"
    return tries(1, tmp_path_factory.mktemp("rigs"), currents)


def test_equal_campaigns_are_not_told_apart(found: list[Try]) -> None:
    equal = next(item for item in found if not item.changed)
    assert not equal.refused
    assert not equal.found and not equal.others
    assert equal.intervals and not equal.missed


def test_five_per_cent_are_found(found: list[Try]) -> None:
    apart = next(item for item in found if item.changed)
    assert apart.found and not apart.others
    low, high = apart.intervals[apart.parameter]
    assert 0.0 < low < high < 2.0 * CHANGE
    # One interval in twenty leaves the change out; one in ten thousand is twice as far off.
    assert abs(CHANGE - 0.5 * (low + high)) < high - low
