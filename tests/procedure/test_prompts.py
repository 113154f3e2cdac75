"""What must be seen once a prompt was answered: read, checked against the rig, compiled."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.config.loader import load_rig
from rigd.config.rig import RigConfig
from rigd.model import ConfigError
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.procedure.program import (
    Agreement,
    Comparison,
    Condition,
    CycleProgram,
    Prompt,
    Segment,
    StatusCondition,
)
from rigd.procedure.steps.agreement import band, check_of

AGREES = "agrees: {with: scale.mass, within: 5 %, for: 1 s}"
TEXT = f"""\
procedure: weighed
title: Puts weights on
doc: For tests.
parameters:
  load: {{doc: Load, unit: kg, default: 5 kg}}
trial:
  steps:
    - prompt: put_on
      text: Put ${{load}} on.
      unit: kg
      answer: ${{load}}
      {AGREES}
      timeout: 15 s
    - step: settle
      until: scale is stable for 0.2 s
      timeout: 20 s
"""
STABLE = StatusCondition("scale", "stable", 1)


@pytest.fixture(scope="module")
def rig() -> RigConfig:
    return load_rig("wire-1")


def prompt_of(text: str, rig: RigConfig) -> Prompt:
    prompt = compile_procedure(parse_procedure(text, Path("p.yaml")), rig).trials[0].steps[0]
    assert isinstance(prompt, Prompt)
    return prompt


def test_answer_rounded_beyond_max_is_max(rig: RigConfig) -> None:
    text = TEXT.replace("answer: ${load}", "answer: 0.4 kg + 0.8 kg + 0.3 kg\n      max: 1.5 kg")
    assert prompt_of(text, rig).answer == 1.5


def test_agreement_share_is_of_the_given_answer(rig: RigConfig) -> None:
    prompt = prompt_of(TEXT, rig)
    assert prompt.agrees == Agreement("scale.mass", 0.05, True, 1.0, STABLE)
    check = check_of(prompt, 5.02)  # what was typed, not what was planned
    low, high = 5.02 - 0.05 * 5.02, 5.02 + 0.05 * 5.02
    inside = (
        Condition("scale.mass", Comparison.ABOVE, low, for_s=1.0),
        Condition("scale.mass", Comparison.BELOW, high, for_s=1.0),
        STABLE,
    )
    assert check == CycleProgram((Segment("put_on", until=(inside,), timeout_s=15.0),))


def test_share_of_negative_answer_is_band_too() -> None:
    agrees = Agreement("belt.speed", 0.05, True, 0.0, None)
    assert band(agrees, -2.0) == pytest.approx((-2.1, -1.9))


def test_agreement_distance_is_in_channel_unit(rig: RigConfig) -> None:
    prompt = prompt_of(TEXT.replace("5 %", "100 g").replace(", for: 1 s", ""), rig)
    assert prompt.agrees == Agreement("scale.mass", 0.1, False, 0.0, STABLE)
    assert band(prompt.agrees, 0.0) == (-0.1, 0.1)


def test_device_without_rest_statement_is_not_asked(rig: RigConfig) -> None:
    text = TEXT.replace("kg", "m").replace("scale.mass", "carriage.position").replace("5 m", "1 m")
    prompt = prompt_of(text, rig)
    assert prompt.agrees is not None
    assert prompt.agrees.stable is None


def test_each_row_of_until_holds_with_the_agreement(rig: RigConfig) -> None:
    also = "until: [carriage.position < 2 mm, scale is not overload for 0.1 s]\n      timeout"
    check = check_of(prompt_of(TEXT.replace("timeout", also, 1), rig), 5.0)
    assert check is not None
    rows = check.segments[0].until
    assert [row[0] for row in rows] == [
        Condition("carriage.position", Comparison.BELOW, 0.002),
        StatusCondition("scale", "overload", 2, wanted=False, for_s=0.1),
    ]
    assert all(row[-1] == STABLE and len(row) == 4 for row in rows)


def test_step_waits_for_word_of_status(rig: RigConfig) -> None:
    steps = compile_procedure(parse_procedure(TEXT, Path("p.yaml")), rig).trials[0].steps
    assert isinstance(steps[1], CycleProgram)
    assert steps[1].segments[0].until == ((StatusCondition("scale", "stable", 1, for_s=0.2),),)


@pytest.mark.parametrize(
    ("old", "new", "token", "parts"),
    [
        ("scale.mass", "scale.mas", "scale.mas,", ["has no channel 'scale.mas'", "'scale.mass'"]),
        ("scale.mass", "carriage.position", "carriage", ["is in m, the answer in kg"]),
        ("5 %", "5 mm", "5 mm", ["'5 mm' is in m, expected kg"]),
        ("5 %", "0 %", "0 %", ["no answer would ever agree"]),
        ("5 %", "-0.1 kg", "-0.1 kg", ["no answer would ever agree"]),
        ("default: 5 kg", "default: 0 kg", "5 %", ["no answer would ever agree", "above 0 kg"]),
        ("for: 1 s", "for: 1 kg", "1 kg}", ["is in kg, expected s"]),
        ("within: 5 %, ", "", "{with", ["key 'within' is missing"]),
        ("      timeout: 15 s\n", "", "agrees", ["could wait forever", "add 'timeout"]),
        (f"      {AGREES}\n", "", "timeout: 15", ["a timeout has no effect"]),
        ("unit: kg\n      answer: ${load}", "free_text: true", "agrees",
         ["only a quantity can agree with a channel"]),
        ("scale is stable", "scale is stabel", "stabel",
         ["does not report whether it is stabel", "did you mean 'stable'"]),
        ("scale is stable", "sclae is stable", "sclae", ["no device 'sclae'", "'scale'"]),
        ("scale is stable", "carriage is stable", "stable for",
         ["carriage (cia406-encoder) does not report", "none of its status bits has a name"]),
        ("stable for 0.2 s", "stable for 0.2 m", "0.2 m", ["is in m, expected s"]),
    ],
)  # fmt: skip
def test_problem_is_reported_at_its_place_in_file(
    rig: RigConfig, old: str, new: str, token: str, parts: list[str]
) -> None:
    assert TEXT.count(old) == 1
    text = TEXT.replace(old, new)
    head = text[: text.index(token)]
    place = f"p.yaml:{head.count(chr(10)) + 1}:{len(head) - head.rfind(chr(10))}: "
    with pytest.raises(ConfigError) as caught:
        compile_procedure(parse_procedure(text, Path("p.yaml")), rig)
    shown = str(caught.value)
    assert place in shown
    for part in parts:
        assert part in shown


def test_a_table_is_read_in_its_unit(rig: RigConfig) -> None:
    table = (
        "  floor: {doc: Floor, choices: [even, steep], default: steep}\n"
        "tables:\n"
        "  slope: {by: floor, unit: deg, values: {even: 0 deg, steep: 15 deg}}\n"
        "trial:"
    )
    text = TEXT.replace("trial:", table, 1).replace("Put ${load} on.", "Tilt it by ${slope}.")
    assert prompt_of(text, rig).text == "Tilt it by 15 deg."
    assert compile_procedure(parse_procedure(text, Path("p.yaml")), rig).units["slope"] == "deg"
    with pytest.raises(ConfigError, match="'15 m' is in m, expected deg"):
        prompt_of(text.replace("15 deg}", "15 m}"), rig)
    with pytest.raises(ConfigError, match="unknown unit 'dag'"):
        prompt_of(text.replace("unit: deg", "unit: dag"), rig)
