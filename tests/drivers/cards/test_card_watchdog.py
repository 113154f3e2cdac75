"""A watchdog of a card is condemned by looks within its time alone, however slow the machine is."""

from __future__ import annotations

import time
from collections.abc import Iterator
from itertools import chain, repeat

import pytest

from rigd.sdk import DeviceError
from rigd_drivers.cards import watchdog as card_watchdog

TIME_S = 0.1


class OneShot:
    """Stays up for its time after it was fed; each look at it takes as long as given, in s."""

    def __init__(self, looks_s: Iterator[float]) -> None:
        self._looks_s = looks_s
        self._fed_s = float("-inf")

    def feed(self) -> None:
        self._fed_s = time.monotonic()

    def is_up(self) -> bool:
        time.sleep(next(self._looks_s))
        return time.monotonic() - self._fed_s <= TIME_S


def proven(one_shot: OneShot) -> float:
    return card_watchdog.prove(
        one_shot.feed, one_shot.is_up, TIME_S, rises="check its wire", falls="check its capacitor"
    )


def test_looks_that_come_late_condemn_no_watchdog() -> None:
    assert proven(OneShot(chain(repeat(1.5 * TIME_S, 8), repeat(0.0)))) > TIME_S


def test_card_too_slow_for_its_watchdog_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(card_watchdog, "_LONGEST_RISE_S", 1.0)
    with pytest.raises(DeviceError, match=r"comes 0\.\d+ s after its last edge") as caught:
        proven(OneShot(repeat(1.5 * TIME_S)))
    assert "too slow" in str(caught.value.hint)
