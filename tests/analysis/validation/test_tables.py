"""Checks the tables of a validation: a value of a condition alone says nothing."""

from __future__ import annotations

from itertools import product

import numpy as np

from rigd.analysis.validation.result import (
    Deviation,
    GroupValidation,
    ModelOutcome,
    ValidatedTrial,
    Validation,
)
from rigd.analysis.validation.tables import overview, pooled_rows

ERROR = Deviation("place", "m", 0.002, 0.001, 0.5, 0.003)
NONE = np.zeros(0)


def robot(*conditions: dict[str, str]) -> Validation:
    trials = tuple(
        ValidatedTrial(f"trial {k}", "a.mcap", item, (ERROR,), NONE, ())
        for k, item in enumerate(conditions, 1)
    )
    group = GroupValidation("circles", "contacts", ModelOutcome.CONFIRMED, "All agree.", trials)
    return Validation("articulated", "", (group,), ("place",), ())


def test_rows_name_the_condition_beside_its_value() -> None:
    many = product(("0.3 s", "0.001 s"), ("100 rad/s", "150 rad/s", "200 rad/s"))
    found = robot(*({"ramp": ramp, "speed": speed, "side": "left"} for ramp, speed in many))
    assert [(row.condition, row.trials) for row in pooled_rows(found)] == [
        ("all", "6"), ("ramp 0.3 s", "3"), ("ramp 0.001 s", "3"),
    ]  # fmt: skip
    table = overview(found)
    assert table is not None
    assert table.rows[1].cells[0] == "ramp 0.3 s, speed 150 rad/s"


def test_repeated_trials_have_their_label() -> None:
    table = overview(robot({"speed": "100 rad/s"}, {"speed": "100 rad/s"}))
    assert table is not None
    assert [row.cells[0] for row in table.rows] == ["trial 1", "trial 2"]
