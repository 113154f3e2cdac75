"""Temperatures in degrees Celsius and gauge pressures, everywhere that a quantity is written."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from rigd.config.loader import parse_rig
from rigd.config.rig import RigConfig
from rigd.model import ConfigError
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.procedure.profiles.profiles import ConstantProfile, Ramp, Sine, TableProfile
from rigd.procedure.program import (
    CompiledProcedure,
    Condition,
    CycleProgram,
    Segment,
    TrialPlan,
)

RIG = r"""
rig: oven
title: An oven and a pressure
cycle: 100 Hz

devices:
  oven:
    driver: line-outputs
    options:
      port: tcp://127.0.0.1:9
      ask: 'MEAS?\n'
      separator: ';'
      columns: [temperature, pressure]
      channels:
        temperature: {unit: 0.1 degC, low: -50 °C, high: 400 °C}
        pressure: {unit: barg, low: -1 barg, high: 10 barg}
      outputs:
        temperature: {unit: degC, low: 0 degC, high: 300 degC, write: 'T {temperature:.1f}\n'}
      safe: 'OFF\n'
      state: {ask: 'ON?\n', safe: '0', ready: '1'}
    limits:
      temperature: {low: 10 degC, high: 250 degC, rate: 6 K/min, rest: 20 degC}
    waiver: {by: A. Person, reason: The emergency stop cuts its mains}

interlocks:
  - name: hot
    source: oven.temperature
    high: 260 degC
    deadband: 5 K
    action: abort
    message: Too hot.
  - name: burst
    source: oven.pressure
    high: 120 psig
    action: abort
    message: Too high.

derived:
  computed.rise: {is: oven.temperature - 25 degC}
  computed.above: {is: "where(oven.temperature > -5 degC, 1, 0)"}

constants:
  ambient: {value: 21.5 degC, u: 0.2 K}
"""

PROCEDURE = """
procedure: heat
title: Heat
doc: For tests.

parameters:
  hot: {doc: Temperature, unit: degC, default: 180 degC, min: 20 degC, max: 482 degF}

sweep:
  grid:
    hot: {from: 100 degC, to: 140 degC, step: 20 K}

trial:
  steps:
    - step: ramp
      set:
        oven.temperature:
          ramp: {from: "${rig.ambient}", to: "${hot}", over: 30 min}
      until: oven.temperature > ${hot} - 2 K for 10 s
      timeout: 1 h
    - step: dip
      set: {oven.temperature: "${hot} - 5 K"}
      until: oven.pressure > 2.5 barg
      timeout: 1 min
    - step: swing
      set:
        oven.temperature:
          sine: {amplitude: 2 K, frequency: 0.005 Hz, offset: 150 degC}
      for: 200 s
    - step: table
      set:
        oven.temperature:
          table: {times: [0 s, 10 min], values: [70 °C, 160 degF]}
      for: 1 s
"""


def oven(text: str = RIG) -> RigConfig:
    return parse_rig(text, Path("rig.yaml"))


def compiled(text: str = PROCEDURE, **overrides: str) -> CompiledProcedure:
    return compile_procedure(parse_procedure(text, Path("p.yaml")), oven(), overrides)


def segments(trial: TrialPlan) -> tuple[Segment, ...]:
    (program,) = trial.steps
    assert isinstance(program, CycleProgram)
    return program.segments


def place_of(text: str, token: str) -> str:
    head = text[: text.index(token)]
    return f"{head.count(chr(10)) + 1}:{len(head) - head.rfind(chr(10))}"


def kelvin(celsius: float) -> Any:
    return pytest.approx(celsius + 273.15, rel=1e-12)


RISE = "{is: oven.temperature - 25 degC}"
SMALL = 'computed.small: {is: "where(computed.rise < 2 degC, 1, 0)"}'


@pytest.mark.parametrize("key", ["", ", lowpass: 1 Hz", ", where: oven.pressure > 1 barg"])
def test_derived_difference_is_no_value_in_celsius(key: str) -> None:
    rig = RIG.replace(RISE, RISE.replace("}", f"{key}}}"))
    with pytest.raises(ConfigError, match=r"write 2 K if the difference is meant, 275.15 K if"):
        oven(rig.replace("\nconstants:", f"  {SMALL}\n\nconstants:"))
    text = PROCEDURE.replace(
        "trial:\n", f"derived:\n  {SMALL.replace('computed.s', 'own.s')}\ntrial:\n"
    )
    with pytest.raises(ConfigError, match="write 2 K if the difference is meant"):
        compile_procedure(parse_procedure(text, Path("p.yaml")), oven(rig), {})


def test_rig_file_in_celsius_is_held_in_kelvin() -> None:
    rig = oven()
    temperature, pressure = rig.devices["oven"].channels[:2]
    limit = rig.devices["oven"].limits["temperature"]
    assert (temperature.unit, pressure.unit) == ("K", "Pa")
    assert (temperature.low, temperature.high) == (kelvin(-50), kelvin(400))
    assert pressure.high == pytest.approx(1e6 + 101_325)
    assert (limit.low, limit.high, limit.rest) == (kelvin(10), kelvin(250), kelvin(20))
    assert limit.rate == pytest.approx(0.1)
    hot, burst = rig.interlocks[:2]
    assert (hot.high, hot.deadband) == (kelvin(260), 5.0)
    assert burst.high == pytest.approx(120 * 6894.757293168 + 101_325)
    assert rig.constants["ambient"].value == kelvin(21.5)
    assert str(rig.constants["ambient"]) == "21.5 degC"


def test_procedure_in_celsius_commands_kelvin() -> None:
    trials = compiled().trials
    assert [trial.parameters["hot"] for trial in trials] == [kelvin(100), kelvin(120), kelvin(140)]
    ramp, dip, swing, table = segments(trials[0])
    heating = ramp.setpoints["oven.temperature"]
    assert isinstance(heating, Ramp)
    assert (heating.start, heating.end) == (kelvin(21.5), kelvin(100))
    condition = ramp.until[0][0]
    assert isinstance(condition, Condition)
    assert condition.threshold == kelvin(98)
    assert dip.setpoints["oven.temperature"] == ConstantProfile(kelvin(95))
    waving = swing.setpoints["oven.temperature"]
    assert isinstance(waving, Sine)
    assert (waving.amplitude, waving.offset) == (2.0, kelvin(150))
    falling = table.setpoints["oven.temperature"]
    assert isinstance(falling, TableProfile)
    assert falling.values == (kelvin(70), kelvin((160 - 32) * 5 / 9))


@pytest.mark.parametrize(
    ("old", "new", "token", "words"),
    [
        (
            "rate: 6 K/min",
            "rate: 6 degC/min",
            "6 degC/min",
            "'degC' in 'degC/min' has a zero of its own",
        ),
        ("deadband: 5 K", "deadband: 5 degC", "5 degC\n", "write '5 K'"),
        ("u: 0.2 K", "u: 0.2 degC", "0.2 degC}", "write '0.2 K'"),
        ("u: 0.2 K", "u: 2 %", "2 %}", "2 % of a value in degC has no meaning"),
        ("u: 0.2 K", "u: 0.2", "0.2}", "write '0.2 K'"),
        ("high: 260 degC", "high: 500 degC", "500 degC", "500 degC is above 400 degC"),
        (
            "temperature - 25 degC",
            "temperature * 27 degC",
            "27 degC",
            "cannot multiply a value in degC",
        ),
        (
            "oven.temperature - 25 degC",
            "20 degC + 25 degC",
            "25 degC}",
            "cannot add a value in degC",
        ),
        (
            "oven.temperature - 25 degC",
            "(5 degC) ** 2",
            "(5 degC) **",
            "cannot raise a value in degC",
        ),
        (
            "oven.temperature - 25 degC",
            "-(5 degC + 1 K)",
            "-(5 degC",
            "cannot negate a value in degC",
        ),
    ],
)
def test_rig_file_misusing_own_zero_is_refused(old: str, new: str, token: str, words: str) -> None:
    assert old in RIG
    text = RIG.replace(old, new, 1)
    with pytest.raises(ConfigError, match=re.escape(words)) as refused:
        oven(text)
    assert f"rig.yaml:{place_of(text, token)}" in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new", "token", "words"),
    [
        ("step: 20 K", "step: 20 degC", "20 degC}", "such as '1 K'"),
        ("amplitude: 2 K", "amplitude: 2 degC", "2 degC, freq", "write '2 K'"),
        (
            "> ${hot} - 2 K",
            "> ${hot} - 2 degC",
            "${hot} - 2 degC",
            "is the difference of two values",
        ),
        ('"${hot} - 5 K"', '"2 * ${ hot }"', "${ hot }", "cannot multiply a value in degC"),
        ('"${hot} - 5 K"', '"${hot} + ${ rig.ambient }"', "${ rig", "cannot add a value in degC"),
        ('"${hot} - 5 K"', '"-${hot}"', '-${hot}"', "cannot negate a value in degC"),
        ('"${hot} - 5 K"', "300 degC", "300 degC", "above the rig's limit"),
        (
            "oven.pressure > 2.5 barg",
            "'|oven.pressure| > 2.5 barg'",
            "|oven",
            "a magnitude cannot",
        ),
        (
            "over: 30 min",
            "over: 1 min",
            '{from: "${rig.ambient}',
            "faster than the rig's limit of 0.1 K/s",
        ),
        ("max: 482 degF", "max: 482 F", "F}", "did you mean 'degF'"),
    ],
)
def test_procedure_misusing_own_zero_is_refused(old: str, new: str, token: str, words: str) -> None:
    assert old in PROCEDURE
    text = PROCEDURE.replace(old, new, 1)
    with pytest.raises(ConfigError, match=re.escape(words)) as refused:
        compiled(text)
    assert f"p.yaml:{place_of(text, token)}" in str(refused.value)


@pytest.mark.parametrize(
    ("text", "celsius"),
    [("-5 degC", -5), ("300 K", 26.85), ("25 degC + 5 K", 30), ("5 K + 25 degC", 30),
     ("10 degC + (30 degC - 5 degC)", 35), ("${rig.ambient} - 1.5 K", 20)],
)  # fmt: skip
def test_sum_with_one_value_on_scale_is_value(text: str, celsius: float) -> None:
    rig = RIG.replace("low: 10 degC", "low: -40 degC", 1).replace(
        "unit: degC, low: 0 degC", "unit: degC, low: -40 degC", 1
    )
    procedure = PROCEDURE.replace('"${hot} - 5 K"', f'"{text}"', 1)
    program = compile_procedure(parse_procedure(procedure, Path("p.yaml")), oven(rig), {})
    _, dip, *_ = segments(program.trials[0])
    assert dip.setpoints["oven.temperature"] == ConstantProfile(kelvin(celsius))
