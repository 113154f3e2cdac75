"""What a driver keeps for good is found by what refers to it, wherever it is kept."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from rigd.sdk.check import Peer
from rigd.sdk.check.leaks import kept_for_good

TURNS = 120
IN_MODULE: list[float] = []


@cache
def doubled(value: float) -> tuple[float, float]:
    return value, 2 * value


def closure() -> Callable[[float], None]:
    kept: list[float] = []
    return lambda value: kept.append(value)


class Keeper:
    in_class: tuple[float, ...] = ()

    def __init__(self) -> None:
        self.turn = 0.5
        self.newest: deque[float] = deque(maxlen=10)
        self.in_list: list[float] = []
        self.in_arrays: list[object] = []
        self.in_dictionary: dict[float, None] = {}
        self.in_closure = closure()
        self.of_another = SimpleNamespace(log=[])

    def next(self) -> float:
        self.turn += 1000.0
        self.newest.append(self.turn)
        return self.turn


KEEPS: dict[str, Callable[[Keeper, float], object]] = {
    "list": lambda keeper, value: keeper.in_list.append(value),
    "module": lambda _, value: IN_MODULE.append(value),
    "class": lambda keeper, value: setattr(Keeper, "in_class", (*keeper.in_class, value)),
    "cache": lambda _, value: doubled(value),
    "closure": lambda keeper, value: keeper.in_closure(value),
    "part of an array": lambda keeper, _: keeper.in_arrays.append(np.zeros(4)[1:]),
    "dictionary": lambda keeper, value: keeper.in_dictionary.setdefault(value),
}


@pytest.mark.parametrize("where", KEEPS)
def test_what_a_driver_keeps_is_found(where: str) -> None:
    keeper = Keeper()
    found = list(kept_for_good(keeper, Peer(), TURNS, lambda: KEEPS[where](keeper, keeper.next())))
    assert len(found) == 1
    assert float(found[0].split()[3]) > 24  # a float is as large


def test_what_others_keep_is_no_leak() -> None:
    keeper = Keeper()
    log = keeper.of_another.log
    assert not list(kept_for_good(keeper, Peer(), TURNS, lambda: log.append(keeper.next())))


def test_threads_that_allocate_meanwhile_disturb_nothing() -> None:
    keeper, ended = Keeper(), threading.Event()

    def work() -> None:
        while not ended.is_set():
            np.arange(5000.0).tolist()

    thread = threading.Thread(target=work)
    thread.start()
    try:
        assert not list(kept_for_good(keeper, Peer(), TURNS, keeper.next))
    finally:
        ended.set()
        thread.join()
