"""A step that lets a simulated device show a fault."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.config.loader import load_rig
from rigd.config.rig import RigConfig
from rigd.model import ConfigError
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.procedure.program import CycleProgram, Fault

STEP = (
    "    - fault: {part: scale, fault: late, after: 20 ms, for: 0.5 s, options: {delay_s: 0.1}}\n"
)
TEXT = f"""\
procedure: faulty
title: Shows a fault
doc: For tests.
trial:
  steps:
    - step: before
      set: {{wheel_servo.current: 0.3 A}}
      for: 1 s
{STEP}\
    - step: behind
      for: 1 s
"""


@pytest.fixture(scope="module")
def wire() -> RigConfig:
    return load_rig("wire-1")


def compiled(text: str, rig: RigConfig) -> tuple[object, ...]:
    return compile_procedure(parse_procedure(text, Path("p.yaml")), rig).trials[0].steps


def test_fault_step_separates_two_programs(wire: RigConfig) -> None:
    before, fault, behind = compiled(TEXT, wire)
    assert isinstance(before, CycleProgram)
    assert isinstance(behind, CycleProgram)
    assert fault == Fault("scale", "late", 0.02, 0.5, {"delay_s": 0.1})


def test_fault_without_times_begins_at_once_and_lasts(wire: RigConfig) -> None:
    text = TEXT.replace(STEP, "    - fault: {part: wheel_servo, fault: silent}\n")
    assert compiled(text, wire)[1] == Fault("wheel_servo", "silent", 0.0, None, {})


@pytest.mark.parametrize(
    ("written", "value"),
    [("0x2310", 0x2310), ("7", 7), ("0.5", 0.5), ("true", True), ("high", "high")],
)
def test_options_are_read_as_yaml_scalars(wire: RigConfig, written: str, value: object) -> None:
    (fault,) = (item for item in compiled(TEXT.replace("delay_s: 0.1", f"one: {written}"), wire)
                if isinstance(item, Fault))  # fmt: skip
    assert fault.options == {"one": value}
    assert type(fault.options["one"]) is type(value)


def test_rig_without_wire_simulation_shows_no_faults() -> None:
    with pytest.raises(ConfigError, match="not simulated at the wire") as error:
        compiled(TEXT, load_rig("lugre-1"))
    assert str(error.value.place) == "p.yaml:9:7"
    assert "simulation:" in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("for: 0.5 s,", "for: 0 s,", "p.yaml:9:60: 0 s must be above 0 s"),
        ("after: 20 ms", "after: 20 mm", "p.yaml:9:48: '20 mm' is in m, expected s"),
        ("part: scale", "prat: scale", "p.yaml:9:15: unknown key 'prat'"),
    ],
)
def test_wrong_fault_is_reported_with_its_place(
    wire: RigConfig, old: str, new: str, told: str
) -> None:
    with pytest.raises(ConfigError) as error:
        compiled(TEXT.replace(old, new), wire)
    assert told in str(error.value)
