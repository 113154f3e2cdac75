"""What an editor reports by the schema: the plain slips, and never anything that check accepts."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from rigd.config.loader import load_rig
from rigd.config.schema import rig_schema
from rigd.language.number import ExpressionError
from rigd.model import ConfigError
from rigd.model.patterns import condition_schema, quantity_schema
from rigd.model.units import PREFIXES, parse_quantity, parse_unit, symbols
from rigd.procedure.compile import compile_procedure
from rigd.procedure.expression import parse_expression
from rigd.procedure.loader import parse_procedure
from rigd.procedure.source import procedure_schema
from rigd.sdk.shipped_files import shipped_folder

TESTS = Path(__file__).resolve().parents[1]
STEP = {"step": "drive", "set": {"wheel_servo.current": "0.6 A"}, "for": "1 s"}
END = {"until": "carriage.position > 1 m", "timeout": "1 s"}


def procedure_with(step: dict[str, Any]) -> dict[str, Any]:
    return {"procedure": "p", "title": "t", "doc": "d", "trial": {"steps": [step]}}


def told(schema: dict[str, Any], data: object) -> list[str]:
    """Return what an editor shows: the messages of the errors, down to the last of each."""
    errors = list(jsonschema.Draft202012Validator(schema).iter_errors(data))
    shown = []
    while errors:
        error = errors.pop()
        errors += error.context or ()
        shown += [error.message, str(error.schema.get("patternErrorMessage", ""))]
        shown.append(str(error.schema.get("errorMessage", "")))
    return shown


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"for": 0.5}, "0.5 is not of type 'string'"),
        ({"for": "0.5"}, "a number with a unit of the kind of s, such as '1 s'"),
        ({"for": "0,5 s"}, "a number with a unit of the kind of s"),
        ({"for": "1 A"}, "a number with a unit of the kind of s"),
        ({"set": {"wheel_servo.current": "600 ma"}}, "a number with its unit, such as '1.5 A'"),
        ({"set": {"a.b": {"sine": {"amplitude": "1 A", "frequency": "2 s"}}}}, "the kind of Hz"),
        ({"for": None, **END, "until": "carriage.position >= 1 m"}, "such as 'carriage.position >"),
        ({**END, "until": "a.b > 1 m or a.b < 0 m"}, "a list ends with any of its conditions"),
        ({**END, "until": ["a.b > 1 m", "a.b"]}, "joined by 'and'"),
        ({"for": ...}, "a step ends by 'for', or by 'until' with a 'timeout'"),
        (
            {"for": ..., "until": "a.b > 1 m"},
            "a step ends by 'for', or by 'until' with a 'timeout'",
        ),
    ],
)
def test_an_editor_refuses_the_slip(changes: dict[str, Any], message: str) -> None:
    step = {key: value for key, value in {**STEP, **changes}.items() if value is not ...}
    assert any(message in item for item in told(procedure_schema(), procedure_with(step)))
    assert told(procedure_schema(), procedure_with(STEP)) == []
    assert told(procedure_schema(), procedure_with({**STEP, **END})) == []


def test_an_editor_refuses_the_slip_in_a_rig() -> None:
    text = (shipped_folder("configs") / "sim_lugre.yaml").read_text("utf-8")
    data = YAML(typ="safe", pure=True).load(text)
    assert told(rig_schema(), data) == []
    data["interlocks"][0]["stale_after"] = "20 ma"
    assert any("the kind of s" in item for item in told(rig_schema(), data))


def texts_of_tests() -> Iterator[str]:
    """Yield every procedure that stands as text in a test."""
    for file in sorted(TESTS.rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            text = node.value if isinstance(node, ast.Constant) else None
            if isinstance(text, str) and re.match(r"\s*procedure: \w+\n", text):
                yield text


def test_no_procedure_that_check_accepts_is_refused() -> None:
    validator = jsonschema.Draft202012Validator(procedure_schema())
    rigs = [load_rig("lugre-1"), load_rig("angle-1")]
    accepted = 0
    for text in texts_of_tests():
        for rig in rigs:
            try:
                compile_procedure(parse_procedure(text, Path("p.yaml")), rig)
            except ConfigError:
                continue
            validator.validate(YAML(typ="safe", pure=True).load(text))
            accepted += 1
    assert accepted >= 5


PREFIXED, BARE = symbols()
SYMBOLS = [*BARE, *PREFIXED, *(prefix + stem for prefix in PREFIXES for stem in PREFIXED)]
NUMBERS = st.sampled_from(["1", "0.5", ".5", "5.", "-1", "+2", "1e3", "-1.5E-2", "--1"])
UNITS = st.sampled_from([*SYMBOLS, "", "m/s", "N m", "1/m", "m^2", "m2", "kg·m²", "s^-1", "ma"])
PLAIN = st.builds(lambda number, blank, unit: f"{number}{blank}{unit}",
                  NUMBERS, st.sampled_from(["", " ", "  "]), UNITS)  # fmt: skip
EXPRESSIONS = st.recursive(
    PLAIN,
    lambda inner: st.one_of(
        inner.map(lambda item: f"({item})"),
        st.builds(lambda a, sign, b: f"{a} {sign} {b}", inner, st.sampled_from("+-*/"), inner),
        inner.map(lambda item: f"max({item}, 2 * {item})"),
    ),
    max_leaves=4,
)
KINDS = [None, "s", "Hz", "rad", "1"]


@settings(max_examples=500, deadline=None, derandomize=True)
@given(EXPRESSIONS)
def test_no_quantity_that_check_accepts_is_refused(text: str) -> None:
    try:
        value = parse_expression(text).value({})
    except ExpressionError:
        return
    assert not isinstance(value, str)
    for unit in KINDS:
        if unit is None or value.dimension == parse_unit(unit).dimension:
            assert re.search(quantity_schema(unit)["pattern"], text), (text, unit)


@pytest.mark.parametrize("symbol", SYMBOLS)
def test_each_unit_is_known_to_all_its_kinds(symbol: str) -> None:
    text = f"2 {symbol}"
    dimension = parse_quantity(text).unit.dimension
    for unit in KINDS:
        is_one = unit is None or dimension == parse_unit(unit).dimension
        assert bool(re.search(quantity_schema(unit)["pattern"], text)) == is_one, unit


@pytest.mark.parametrize(
    "text",
    [
        "carriage.position > 1.15 m", "|belt.speed| < 3 mm/s for 0.2 s", "a.b>${x}",
        "scale is stable", "scale is not stable for 1 s and a.b < -1 m", "a.b > 1 m\nand a.b < 2 m",
        "floor_sensor.order > 1",
    ],
)  # fmt: skip
def test_no_condition_that_check_accepts_is_refused(text: str) -> None:
    assert re.search(condition_schema()["pattern"], text)
