"""Derived channels of a procedure: what they become, and every way to get one wrong."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rigd.computed.derived.driver import DerivedConfig
from rigd.config.loader import parse_rig
from rigd.config.rig import RigConfig
from rigd.model import ConfigError
from rigd.model.errors import OtherRigError
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.procedure.program import CompiledProcedure, CycleProgram, Recorded

Compile = Callable[..., CompiledProcedure]

DERIVED = """\
derived:
  motion.speed: {is: derivative(carriage.position), lowpass: 50 Hz}
  motion.share: {is: "motion.speed / ${speed}", doc: of the speed of the belt}

"""


def deriving(small: str, derived: str = DERIVED) -> str:
    return small.replace("trial:\n", f"{derived}\ntrial:\n", 1)


def with_rig_derived(rig: RigConfig) -> RigConfig:
    """The rig with a derived channel and a derived condition of its own."""
    own = (
        "derived:\n  own.speed: {is: derivative(carriage.position)}\n"
        "  own.fast: {is: own.speed > 1 m/s}\n  own.two: {is: 2 * rig.wheel_radius}\n"
    )
    text = rig.source.text.replace("interlocks:\n", f"{own}interlocks:\n", 1)
    return parse_rig(text, rig.source.path)


def test_rig_of_run_has_channels_of_procedure(
    compile_text: Compile, small: str, rig: RigConfig
) -> None:
    compiled = compile_text(deriving(small))
    whole = compiled.on(rig)
    assert "motion" not in rig.devices
    assert [device for device in whole.devices if device not in rig.devices] == ["motion"]
    share = whole.channel("motion.share")
    assert share is not None
    assert (share.unit, share.doc) == ("1", "of the speed of the belt")
    assert "motion" not in compiled.record  # it names the streams that it wants
    every = deriving(small).replace("record: {wheel_servo: 1,", "record: {motion: 1,")
    assert compile_text(every).record["motion"] == Recorded()


def test_parameter_of_run_is_part_of_formula(small: str, rig: RigConfig) -> None:
    procedure = parse_procedure(deriving(small), Path("small.yaml"))
    values = []
    for overrides in ({}, {"speed": "0.5 m/s"}):
        config = compile_procedure(procedure, rig, overrides).on(rig).devices["motion"].config
        assert isinstance(config, DerivedConfig)
        values.append(config.graph.parameters)
    assert (0.1 in values[0], 0.5 in values[1], 0.1 in values[1]) == (True, True, False)


def test_end_limit_and_signal_may_use_them(compile_text: Compile, small: str) -> None:
    text = deriving(small).replace("carriage.position > 1 m", "motion.share > 0.5 for 20 ms")
    text = text.replace("carriage.position: {low", "motion.speed: {high: 2 m/s}\n    carriage.po"
                        "sition: {low")  # fmt: skip
    (program,) = (
        step for step in compile_text(text).trials[0].steps if isinstance(step, CycleProgram)
    )
    assert program.segments[0].until[0][0].channel == "motion.share"
    assert program.limits[0].channel == "motion.speed"


def test_one_graph_computes_rig_and_procedure(small: str, rig: RigConfig) -> None:
    rig = with_rig_derived(rig)
    derived = """\
derived:
  seen.double: {is: "where(own.fast, 2 * own.speed, own.speed)"}
  seen.smooth: {is: "lowpass(own.speed, own.two / 1 m * 100 Hz)"}
"""
    procedure = parse_procedure(deriving(small, derived), Path("small.yaml"))
    whole = compile_procedure(procedure, rig).on(rig)
    graphs = {
        name: device.config.graph
        for name, device in whole.devices.items()
        if isinstance(device.config, DerivedConfig)
    }
    assert list(graphs) == ["own", "seen"]
    assert graphs["own"] is graphs["seen"]
    assert list(graphs["own"].groups()) == ["own", "seen"]
    assert graphs["own"].uses["seen.double"] == {"carriage.position"}
    before = rig.devices["own"].config
    assert isinstance(before, DerivedConfig)
    assert graphs["own"].rows[: len(before.graph.rows)] == before.graph.rows


@pytest.mark.parametrize(
    ("derived", "token", "part"),
    [
        ("a.b: {is: carriage.positon}", "carriage.positon", "'carriage.position'?"),
        ("a.b: {is: carriage.position + 3 s}", "3 s", "cannot add s and m"),
        ('a.b: {is: "carriage.position / ${sped}"}', "${sped}", "did you mean 'speed'?"),
        ('a.b: {is: "delay(carriage.position, ${current})"}', "${current}", "a fixed quantity"),
        ('a.b: {is: "carriage.position * ${floor}"}', "${floor}", "floor is a word"),
        ('a.b: {is: "lowpass(carriage.position, ${speed})"}', "${speed}", "expected 1/s"),
        ("carriage.b: {is: carriage.position}", "carriage.b", "is a device of this rig"),
        ("own.c: {is: carriage.position}", "own.c", "is a group of this rig"),
        ("own.speed: {is: carriage.position}", "own.speed", "is a group of this rig"),
        ("a.b: {is: a.c}\n  a.c: {is: a.b}", "a.b}", "a.b uses a.c uses a.b"),
        ("a.b: {is: own.speed + own.fast}", "own.fast", "found a condition"),
        ("a.b: {is: carriage.position, low: 3}", "low", "unknown key 'low'"),
    ],
)
def test_wrong_channel_is_named_with_its_place(
    small: str, rig: RigConfig, derived: str, token: str, part: str
) -> None:
    text = deriving(small, f"derived:\n  {derived}\n")
    with pytest.raises(ConfigError) as caught:
        compile_procedure(parse_procedure(text, Path("small.yaml")), with_rig_derived(rig))
    problems = [caught.value, *caught.value.others]
    assert any(part in f"{item.message} {item.hint}" for item in problems), caught.value
    begin = text.index("derived:")
    offset = text.index(token, begin)
    line = text.count("\n", 0, offset) + 1
    column = offset - text.rfind("\n", 0, offset)
    assert (line, column) in [
        (item.place.line, item.place.column) for item in problems if item.place
    ]


def test_procedure_of_another_rig_names_what_is_lacking(small: str, rig: RigConfig) -> None:
    text = deriving(small, "derived:\n  a.b: {is: load_cell.force * rig.arm}\n")
    with pytest.raises(ConfigError) as caught:
        compile_procedure(parse_procedure(text, Path("small.yaml")), rig)
    assert isinstance(caught.value, OtherRigError)
    assert caught.value.missing == ("load_cell",)
