"""Any dataclass as JSON: no NaN, no enum, no array is left."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from datetime import date
from enum import Enum, IntEnum
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigd.analysis.plain_data import plain, plain_object


class Colour(Enum):
    RED = "red"


class Level(IntEnum):
    HIGH = 3


@dataclass(frozen=True)
class Inner:
    value: float
    colour: Colour = Colour.RED


@dataclass(frozen=True)
class Renamed:
    speed: float

    def shape(self) -> dict[str, object]:
        return {"speed_m_per_s": self.speed, "inner": Inner(math.inf)}


@dataclass(frozen=True, eq=False)
class Outer:
    values: np.ndarray
    by_name: dict[str, Inner]
    path: Path = Path("runs/a.mcap")
    made: date = date(2026, 11, 21)
    level: Level = Level.HIGH
    nothing: None = None


def test_a_dataclass_becomes_its_fields_in_order() -> None:
    told = plain_object(Outer(np.array([1.0, math.nan]), {"a": Inner(2.0)}))
    assert json.dumps(told, allow_nan=False) == (
        '{"values": [1.0, null], "by_name": {"a": {"value": 2.0, "colour": "red"}}, '
        '"path": "runs/a.mcap", "made": "2026-11-21", "level": 3, "nothing": null}'
    )


def test_declared_json_form_renames_the_keys() -> None:
    assert plain(Renamed(1.5)) == {"speed_m_per_s": 1.5, "inner": {"value": None, "colour": "red"}}


@given(st.recursive(st.floats() | st.integers() | st.booleans() | st.text() | st.none(),
                    lambda inner: st.lists(inner, max_size=3), max_leaves=8))  # fmt: skip
def test_any_nest_of_values_can_be_written(value: object) -> None:
    json.dumps(plain(value), allow_nan=False)


def test_numbers_of_numpy_are_numbers() -> None:
    told = plain([np.float64(1.5), np.int64(2), np.bool_(True), np.float32("nan")])
    assert json.dumps(told) == "[1.5, 2, true, null]"


@pytest.mark.parametrize("value", [object(), {1, 2}, Inner])
def test_a_value_without_a_rule_is_refused(value: object) -> None:
    with pytest.raises(TypeError, match="no JSON form"):
        plain(value)
    with pytest.raises(TypeError):
        plain_object([1.0])
