"""What a procedure measures and demands, checked before anything moves, each mistake in place."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

import pytest

from rigd.model import ConfigError
from rigd.procedure.program import CompiledProcedure, Window

Compile = Callable[..., CompiledProcedure]

MEASURE = """
measure:
  breakaway: {channel: wheel_servo.current, when: carriage.position > 1 mm, unit: mA}
  push: {mean: wheel_servo.current, during: drive, u: 0.5 %}
  late: {max: carriage.position, during: last 0.5 s of drive}
  early: {rms: wheel_servo.current, during: "0.1 s to 0.3 s of drive"}
  way: {slope: carriage.position, during: first 1 s of drive, unit: mm/s}
  echo: {final: wheel_servo.current_setpoint}
  time: {duration: {from: carriage.position > 1 cm, to: carriage.position > 50 cm}}
accept:
  push: ["0.9 * ${current}", "1.1 * ${current}"]
  breakaway: {max: 400 mA}
"""


@pytest.fixture
def text(small: str) -> str:
    return small.replace("record: {wheel_servo: 1, truth: 10}", "record: all") + MEASURE


def test_measures_are_compiled_to_si(text: str, compile_text: Compile) -> None:
    found = {item.name: item for item in compile_text(text).measures}
    assert list(found) == ["breakaway", "push", "late", "early", "way", "echo", "time"]
    assert found["breakaway"].when[0][0].threshold == pytest.approx(1e-3)
    assert (found["breakaway"].low, found["breakaway"].high) == (-math.inf, 0.4)
    assert found["push"].low == pytest.approx(0.45)  # of the first trial, 0.5 A
    assert found["push"].systematic is not None
    assert found["late"].window == Window("drive", last_s=0.5)
    assert found["early"].window == Window("drive", 0.1, 0.3)
    assert found["way"].window == Window("drive", end_s=1.0)
    assert found["time"].since[0][0].threshold == pytest.approx(0.01)
    assert [item.is_judged for item in found.values()] == [True, True, *[False] * 5]


@pytest.mark.parametrize(
    ("old", "new", "token", "words"),
    [
        ("channel: wheel_servo.current", "channel: wheel_servo.curent", "wheel_servo.curent",
         "no channel 'wheel_servo.curent'"),
        ("carriage.position > 1 mm", "carriage.positon > 1 mm", "carriage.positon > 1",
         "no channel 'carriage.positon'"),
        ("carriage.position > 1 mm", "carriage.position > 1 N", "1 N", "'1 N' is in N, expected m"),
        ("carriage.position > 1 mm", "carriage.position > 9 m", "carriage.position > 9",
         "can never be reached"),
        ("carriage.position > 1 mm", "wheel_servo is stable", "wheel_servo is",
         "compares no channel"),
        ("during: drive,", "during: driv,", "driv,", "no step of the trial is called 'driv'"),
        ("during: drive,", "during: back,", "back, u", "no step of the trial is called 'back'"),
        ("during: drive,", "during: last 2 m of drive,", "last 2 m", "'2 m' is in m, expected s"),
        ("during: drive,", "during: last 0 s of drive,", "last 0 s", "must be above 0 s"),
        ("during: drive,", "during: 7 of drive,", "7 of", "cannot read '7 of drive' as a part"),
        ("during: drive,", "during: {of: drive},", "during: {of", "it has no condition"),
        ("during: drive,", "during: {to: carriage.position > 1 N, of: drive},", "1 N, of",
         "'1 N' is in N, expected m"),
        ("during: drive,", "during: {to: carriage.position > 1 mm, of: driv},", "driv},",
         "no step of the trial is called 'driv'"),
        ("during: drive,", "during: {to: carriage.position > 1 mm, nth: 2},", "nth",
         "'nth' has no effect without 'from'"),
        ("0.1 s to 0.3 s", "0.3 s to 0.1 s", '"0.3 s to', "does not follow"),
        ("last 0.5 s of drive", "last 20 s of drive", "last 20 s",
         "step 'drive' takes 4 s at most, less than the 20 s that are measured"),
        ("0.1 s to 0.3 s", "5 s to 6 s", '"5 s to', "takes 4 s at most, less than the 6 s"),
        ("unit: mA", "unit: mV", "mV", "the measure is in A, not in mV"),
        ("unit: mA", "unit: mX", "mX", "unknown unit 'mX'"),
        ("u: 0.5 %", "u: 0.5 N", "0.5 N", "the uncertainty '0.5 N' is in N, expected A or %"),
        ("u: 0.5 %", "u: -1 mA", "-1 mA", "below 0"),
        ("{max: carriage.position,", "{max: carriage.position, min: carriage.position,",
         "late: {max", "exactly one kind of measure, found max, min"),
        ("{max: carriage.position,", "{", "late: { during", "found none"),
        (", when: carriage.position > 1 mm", "", "breakaway: {channel", "key 'when' is missing"),
        ("{mean: wheel_servo.current,",
         "{mean: wheel_servo.current, when: carriage.position > 1 m,",
         "when: carriage.position > 1 m,", "'when' has no effect beside 'mean'"),
        ("{max: 400 mA}", "{max: 400 mV}", "400 mV", "'400 mV' is in V, expected mA"),
        ("{max: 400 mA}", "[0.4, 0.5]", "0.4, 0.5", "has no unit, expected mA"),
        ("{max: 400 mA}", "[500 mA, 400 mA]", "[500", "the first bound is not below the second"),
        ("{max: 400 mA}", "{}", "breakaway: {}", "bounds nothing"),
        ("  breakaway: {max", "  brakeaway: {max", "brakeaway", "the procedure measures no 'brake"),
        ("{max: 400 mA}", "[400 mA]", "[400", "at least 2"),
        ("{slope: carriage", "{slop: carriage", "slop:", "did you mean 'slope'"),
    ],
)  # fmt: skip
def test_mistake_is_named_with_its_place(
    text: str, compile_text: Compile, old: str, new: str, token: str, words: str
) -> None:
    assert old in text
    spoilt = text.replace(old, new, 1)
    head = spoilt[: spoilt.index(token)]
    place = f"p.yaml:{head.count(chr(10)) + 1}:{len(head) - head.rfind(chr(10))}"
    with pytest.raises(ConfigError, match=re.escape(words)) as refused:
        compile_text(spoilt)
    assert place in str(refused.value)


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ("{wheel_servo: 1}", "carriage.position is not recorded"),
        ("{wheel_servo: 1, carriage: {during: back}}",
         "carriage.position is not recorded in all of"),
        ("{wheel_servo: 1, carriage: {when: carriage.position > 1 m, before: 1 s, after: 1 s}}",
         "carriage.position is not recorded in all of"),
    ],
)  # fmt: skip
def test_measure_of_unrecorded_channel_is_refused(
    text: str, compile_text: Compile, record: str, words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        compile_text(text.replace("record: all", f"record: {record}"))


def test_bounds_of_every_trial_are_checked(text: str, compile_text: Compile) -> None:
    # Wrong in the last trial only, at 1.5 A.
    spoilt = text.replace('["0.9 * ${current}", "1.1 * ${current}"]', '["${current}", 1.4 A]')
    with pytest.raises(ConfigError, match="first bound is not below"):
        compile_text(spoilt)


def test_step_named_like_window_is_measured(text: str, compile_text: Compile) -> None:
    name = "rise to peak of force"
    found = {item.name: item for item in compile_text(text.replace("drive", name)).measures}
    assert found["push"].window == Window(name)
    assert found["late"].window == Window(name, last_s=0.5)
