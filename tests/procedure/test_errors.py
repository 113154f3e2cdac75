"""Every way to get a procedure wrong, each reported at its exact place with what to do."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from rigd.model import ConfigError
from rigd.procedure.program import CompiledProcedure

Compile = Callable[..., CompiledProcedure]


def place_of(text: str, token: str) -> str:
    head = text[: text.index(token)]
    return f"{head.count(chr(10)) + 1}:{len(head) - head.rfind(chr(10))}"


RANGE = "{from: 0.5 A, to: 1.5 A, step: 0.5 A}"
DRIVE = "wheel_servo.current: ${current}"
END = "until: carriage.position > 1 m"


@pytest.mark.parametrize(
    ("old", "new", "token", "parts"),
    [
        # keys and shapes
        ("title:", "titel:", "titel", ["unknown key 'titel'", "did you mean 'title'"]),
        ("timeout: 4 s", "timeuot: 4 s", "timeuot", ["unknown key 'timeuot'", "'timeout'"]),
        ("answer:", "anwser:", "anwser", ["unknown key 'anwser'", "'answer'"]),
        ("on_timeout: next", "on_timeout: nxt", "nxt", ["fail, end_trial, next", "'next'"]),
        ("  - step: hold\n    set", "  - stepp: hold\n    set", "stepp", ["unknown key 'stepp'"]),
        ("step: drive", "step: back", "back\n      set: {long", ["'back' is used twice; first in"]),
        ("timeout: 4 s", "timeout: 4 s\n      hold: {timeout: 1 m}", "1 m}", ["expected s"]),
        ("timeout: 4 s",
         "timeout: 4 s\n      hold: {set: {wheel_servo.current: 7 A}, timeout: 1 s}", "7 A}",
         ["above the rig's limit of 1.6 A"]),
        ("for: 0.1 s", "for: 0.1 s\n    hold: {timeout: 1 s}", "hold: {",
         ["a step of 'finish' cannot be held"]),
        # units and expressions
        ("timeout: 4 s", "timeout: 4 m", "4 m\n", ["'4 m' is in m, expected s"]),
        ("timeout: 4 s", "timeout: 4", "4\n      on", ["'4' has no unit, expected s", "'4 s'"]),
        ("timeout: 4 s", "timeout: 0 s", "0 s\n", ["must be above 0 s"]),
        (DRIVE, "wheel_servo.current: 1.5 V", "1.5 V", ["is in V, expected A"]),
        (DRIVE, "wheel_servo.current: 2 * ${curent}", "${curent}",
         ["unknown name '${curent}'", "did you mean 'current'"]),
        (DRIVE, "wheel_servo.current: ${current} + 7 m", "7 m", ["cannot add m and A"]),
        (DRIVE, "wheel_servo.current: ${current} / 0e0", "0e0", ["division by zero"]),
        (DRIVE, "wheel_servo.current: ${floor}", "${floor}\n        long", ["'stone' is a word"]),
        (DRIVE, "wheel_servo.current: 1.5 A)", ")\n        long", ["cannot read ')'"]),
        ("${rig.moving_mass}", "${rig.mass}", "${rig.mass}", ["unknown name '${rig.mass}'"]),
        ("Lay ${floor}", "Lay ${Floor}", "${Floor}", ["unknown name '${Floor}'"]),
        ("Lay ${floor}", "Lay ${rig.Mass}", "${rig.Mass}", ["unknown name '${rig.Mass}'"]),
        # names of the rig
        ("wheel_servo.current: ${", "wheel_servo.curent: ${", "wheel_servo.curent",
         ["no setpoint 'wheel_servo.curent'", "did you mean 'wheel_servo.current'"]),
        ("wheel_servo.current: ${", "carriage.position: ${", "carriage.position: ${",
         ["is measured by the rig lugre-1, not commanded"]),
        (END, "until: carrige.position > 1 m", "carrige.position >",
         ["no channel 'carrige.position'", "did you mean 'carriage.position'"]),
        ("{wheel_servo: 1, truth: 10}", "{wheel_servo: 1, thruth: 10}", "thruth",
         ["no stream 'thruth'", "did you mean 'truth'"]),
        ("{wheel_servo: 1, truth: 10}", "{wheel_servo: 0}", "0}", ["'0' must be at least 1"]),
        ("{wheel_servo: 1, truth: 10}", "{truth: {during: [drive, bakc]}}", "bakc",
         ["the procedure has no step 'bakc'", "did you mean 'back'"]),
        ("{wheel_servo: 1, truth: 10}", "{truth: {during: floor_prompt}}", "floor_prompt}}",
         ["the procedure has no step 'floor_prompt'"]),
        ("{wheel_servo: 1, truth: 10}", "{truth: {every: 0, during: drive}}", "0, during",
         ["'0' must be at least 1"]),
        ("{wheel_servo: 1, truth: 10}", "{truth: {every: 2}}", "{every: 2}", ["during"]),
        ("{wheel_servo: 1, truth: 10}", "{truth: {during: []}}", "[]}}", ["at least 1"]),
        ("wheel_encoder.angle", "wheel_encoder.angel", "wheel_encoder.angel", ["no channel"]),
        ("carriage.position: {low", "carriage.positio: {low", "carriage.positio:", ["no channel"]),
        ("group_by: floor", "group_by: flor", "flor\n", ["unknown parameter 'flor'", "'floor'"]),
        # limits of the trial that the sensor never reaches
        ("carriage.position: {low: -30 mm, high: 1.5 m}",
         "carriage.position: {low: -30 mm, high: 9 m}", "9 m}",
         "9 m is above 1.8 m, the limit of what the channel can measure"),
        # limits of the rig, for every trial of the sweep
        ("max: 1.5 A}", "max: 9 A}", "${current}",
         ["wheel_servo.current 2 A is above the rig's limit of 1.6 A"]),
        (DRIVE, "wheel_servo.current: ${current} - 2.2 A", "${current}",
         ["wheel_servo.current -1.7 A is below the rig's limit of -1.6 A"]),
        (DRIVE, "wheel_servo.current: {sine: {amplitude: 1.7 A, frequency: 1 Hz}}", "1.7 A",
         ["above the rig's limit of 1.6 A"]),
        (DRIVE, "wheel_servo.current: {sine: {amplitude: 1 A, frequency: 400 Hz}}", "{amplitude",
         ["would change by 2513.27 A/s", "the rig's limit of 2000 A/s"]),
        (DRIVE, "wheel_servo.current: {ramp: {from: 0 A, to: 1 A, over: 0.1 ms}}", "{from: 0 A",
         ["faster than the rig's limit"]),
        (DRIVE, "wheel_servo.current: {chirp: {amplitude: 1 A, from: 1 Hz, to: 0 Hz, over: 1 s}}",
         "0 Hz,", ["must be above 0 Hz"]),
        (DRIVE, "wheel_servo.current: {prbs: {amplitude: 1 A, bit: 1 ms, order: 8}}", "8}",
         ["order 8 is not one of 5, 7, 9"]),
        (DRIVE, "wheel_servo.current: {table: {times: [0 s, 1 s], values: [0 A]}}", "[0 s, 1 s]",
         ["2 times for 1 values"]),
        (DRIVE, "wheel_servo.current: {table: {times: [0 s, 0 s], values: [0 A, 1 A]}}",
         "0 s], values", ["does not follow"]),
        (DRIVE, "wheel_servo.current: {}", "{}", ["expected exactly one profile, found 0"]),
        (DRIVE, "wheel_servo.current: {sinus: {}}", "sinus", ["unknown key 'sinus'", "'sine'"]),
        # parameters and sweep
        (RANGE, "{from: 0.5 A, to: 1.6 A, step: 0.5 A}", "1.6 A,",
         ["current 1.6 A is above its max 1.5 A"]),
        (RANGE, "{from: 0.5 A, to: 1.4 A, step: 0.5 A}", "1.4 A,", ["is 1.8 steps from 0.5 A"]),
        (RANGE, "{from: 0.5 A, to: 1.5 A, step: -0.5 A}", "-0.5 A", ["never leads from 0.5 A"]),
        (RANGE, "{from: 0.5 A, to: 1.5 A, step: 0 A}", "0 A}\n\nprep", ["never leads from 0.5 A"]),
        (RANGE, "{from: 0.5 A, to: 1.5 A, step: 1 nA}", "1 nA", ["1e+09 values are more than"]),
        (RANGE, "{from: 0.5 A, to: 1.5 A, step: 0.5 V}", "0.5 V", ["the step is in"]),
        (RANGE, "[0.5 A, 1.5 V]", "1.5 V", ["expected A"]),
        (RANGE, "[0.5 A, 1.7 A]", "1.7 A", ["above its max"]),
        (RANGE, "[0.5 A, 1,2 A]", "1,2 A", ["1,2 A are two values", "decimal point: 1.2 A"]),
        ("    current: {from", "    curent: {from", "curent:", ["no parameter 'curent'"]),
        ("  grid:\n", "  order: random\n  grid:\n", "random", ["needs a seed"]),
        ("  grid:\n", "  seed: 3\n  grid:\n", "seed: 3", ["no effect in the order given"]),
        ("default: stone", "default: ston", "ston}", ["'ston' is not a choice", "'stone'"]),
        ("default: 100 mm/s", "default: 100 mm", "100 mm,", ["is given as 0.1 m, expected mm/s"]),
        ("default: 100 mm/s", "default: 2 m/s", "2 m/s,", ["2000 mm/s is above its max 1000 mm/s"]),
        ("default: 100 mm/s, ", "", "speed: {", ["speed has no value", "--set speed=..."]),
        ("unit: A, min", "unit: Amp, min", "Amp,", ["unknown unit 'Amp'"]),
        ("wheel_servo.current: 0 A", "wheel_servo.current:0 A", "wheel_servo.current:0 A",
         ["not a valid name", "write 'wheel_servo.current: 0 A', with a space after the colon"]),
        ("by: floor\n    values", "by: current\n    values", "current\n    values",
         ["not a parameter with choices"]),
        (", pvc: 0.022}", "}", "values: {stone", ["'pvc' of floor has no value"]),
        ("pvc: 0.022}", "pvc: 0.022, lino: 1}", "lino", ["'lino' is not a choice of floor"]),
        ("text: Lay ${floor}", "text: Lay ${current}", "${current} and",
         ["unknown name '${current}'", "the sweep varies current", "only inside 'trial'"]),
        # ends of steps
        ("      timeout: 4 s\n      on_timeout: next\n", "", "carriage.position > 1 m",
         ["the step 'drive' could wait forever", "add 'timeout"]),
        ("    for: 0.1 s\n", "", "hold\n", ["the step 'hold' has no end"]),
        ("    for: 0.1 s\n", "    for: 1 s\n    timeout: 1 s\n", "timeout: 1 s", ["no effect"]),
        (END, "until: carriage.position >= 1.01 m", "1.01 m",
         ["cannot contain '>='", "'>' or '<'"]),
        (END, "until: carriage.position > 1 m OR carriage.position < 0 m", "OR carriage",
         ["unknown sign 'OR'", "write 'or'"]),
        (END, "until: carriage.position > 1 m or carriage.positon < 0 m", "carriage.positon",
         ["no channel 'carriage.positon'"]),
        (END, "until: carriage.position > 1 m && carriage.position < 2 m", "&&", ["write 'and'"]),
        (END, "until: carriage.position is 1.01 m", "1.01 m", ["a word is missing after 'is'"]),
        (END, "until: carriage.position > 1,15 m", ",15 m", ["decimal point", "write 1.15 m"]),
        (END, "until: carriage.position > 600 MM", "MM", ["did you mean 'mm'?"]),
        (END, "until: carriage.position > 1 s", "1 s\n", ["'1 s' is in s, expected m"]),
        (END, "until: carriage.position > 1.55 m", "carriage.position > 1.55",
         ["can never be reached", "the trial's limit keeps it between -0.03 m and 1.5 m"]),
        ("high: 1.5 m", "high: 1.79 m", "carriage.position > 1.7", ["overrun_far keeps it"]),
        (END, "until: carriage.position > 2 m", "carriage.position > 2 m",
         ["measures between -0.1 m and"]),
        (END, "until: \"|carriage.position| < 0 m\"", "|carriage.position| <", ["never be"]),
        (END, "until: \"|carriage.position < 1 m\"", "< 1 m", ["a '|' is missing"]),
        (END, "until: carriage.position > 1 m for 5 s", "carriage.position > 1 m for 5",
         ["the step 'drive' ends after 4 s, before a condition of its 'until' can have held"]),
        (END, "until: carriage.position > 1 m for 2 s\n      for: 1.5 s",
         "carriage.position > 1 m for 2", ["ends after 1.5 s"]),
        # prompts
        ("answer: ${floor}", "answer: pvc", "pvc\n    changes", ["'pvc' is not one of"]),
        ("    choices: [\"${floor}\"]\n", "    unit: kg\n    choices: [a]\n",
         "prompt: floor_prompt", ["unit, choices and free_text exclude each other"]),
        ("    answer: ${floor}\n", "", "changes: floor", ["would have no answer"]),
        # what the plant has
        ("changes: floor", "changes: flour", "flour",
         ["the plant of lugre-1 has no 'flour' to change", "did you mean 'floor'?"]),
        ("changes: floor", "changes: load", "load", ["has no 'load'", "known: floor, mass"]),
        ("choices: [\"${floor}\"]\n    answer: ${floor}", "free_text: true\n    answer: carpet",
         "carpet", ["floor cannot be 'carpet': it takes stone, pvc, paperboard"]),
        ("choices: [\"${floor}\"]\n    answer: ${floor}\n    changes: floor",
         "unit: kg\n    answer: 21 kg\n    changes: mass",
         "21 kg", ["mass cannot be 21 kg: it takes 0.5 kg to 20 kg"]),
        ("choices: [\"${floor}\"]\n    answer: ${floor}\n    changes: floor",
         "unit: N\n    answer: 1 N\n    changes: mass",
         "mass\n",
         ["the prompt asks for N, but mass on the plant of lugre-1 takes 0.5 kg to 20 kg"]),
    ],
)  # fmt: skip
def test_problem_is_reported_at_its_place_in_file(
    compile_text: Compile, small: str, old: str, new: str, token: str, parts: list[str]
) -> None:
    assert small.count(old) == 1, f"{old!r} stands {small.count(old)} times"
    text = small.replace(old, new)
    if "1.79" in new:  # the trial's limit gives way to the rig's interlock
        text = text.replace(END, "until: carriage.position > 1.7 m")
    if "9 A}" in new:
        text = text.replace(RANGE, "[2 A]")
    with pytest.raises(ConfigError) as caught:
        compile_text(text)
    shown = str(caught.value)
    assert f"p.yaml:{place_of(text, token)}: " in shown
    for part in parts:
        assert part in shown


@pytest.mark.parametrize(
    ("overrides", "part"),
    [
        ({"curent": "1 A"}, "--set curent: the procedure has no parameter 'curent'"),
        ({"current": "1 V"}, "--set current=1 V: current is given as 1 V"),
        ({"current": "9 A"}, "--set current=9 A: current 9 A is above its max 1.5 A"),
        ({"current": "a lot"}, "--set current=a lot: expected a quantity"),
        ({"floor": "ice"}, "--set floor=ice: 'ice' is not a choice of floor"),
    ],
)
def test_overrides_are_checked(
    compile_text: Compile, small: str, overrides: dict[str, str], part: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        compile_text(small, **overrides)
    assert part in str(caught.value)
    assert not caught.value.others


def test_override_of_part_of_a_row_is_refused(compile_text: Compile, small: str) -> None:
    text = small.replace(" and go at ${speed}", "")
    text = text.replace("  grid:", "  zip:\n    speed: [1 mm/s, 2 mm/s, 3 mm/s]")
    with pytest.raises(ConfigError, match="row by row from 'zip', with speed") as caught:
        compile_text(text, current="1 A")
    assert not caught.value.others
    assert len(compile_text(text, current="1 A", speed="2 mm/s").trials) == 1


def test_zip_with_unequal_lengths_is_refused(compile_text: Compile, small: str) -> None:
    text = small.replace("  grid:", "  zip:\n    floor: [stone, pvc]")
    with pytest.raises(ConfigError, match=r"length \(floor: 2, current: 3\)"):
        compile_text(text)


def test_excessive_sweep_is_refused_before_it_is_made(compile_text: Compile, small: str) -> None:
    text = small.replace(RANGE, "{from: 0 A, to: 1.5 A, step: 0.1 mA}").replace(
        "prepare:", "repeats: 1000\nprepare:", 1
    )
    with pytest.raises(ConfigError, match="15001000 trials are more than 20000"):
        compile_text(text)


def test_a_problem_of_many_trials_is_reported_once(compile_text: Compile, small: str) -> None:
    with pytest.raises(ConfigError) as caught:
        compile_text(small.replace("timeout: 4 s", "timeout: 4 m"))
    assert not caught.value.others


def test_decimal_comma_in_list_is_one_problem(compile_text: Compile, small: str) -> None:
    with pytest.raises(ConfigError, match="1,2 A are two values") as caught:
        compile_text(small.replace(RANGE, "[0.5 A, 1,2 A]"))
    assert not caught.value.others


@pytest.mark.parametrize(("unit", "meant"), [("ma", "mA"), ("Ampere", None)])
def test_mistyped_unit_is_one_problem(
    compile_text: Compile, small: str, unit: str, meant: str | None
) -> None:
    with pytest.raises(ConfigError, match=f"unknown unit '{unit}'") as caught:
        compile_text(small.replace("unit: A, min", f"unit: {unit}, min"))
    assert (meant or "") in caught.value.message
    assert bool(caught.value.others) == (meant is None)


def test_rig_file_is_no_procedure(compile_text: Compile) -> None:
    with pytest.raises(ConfigError, match=r"p\.yaml:1:1: this is a rig file") as caught:
        compile_text("rig: bench\ntitle: Bench\ncycle: 1 kHz\ndevices: {}\n")
    assert "--rig" in (caught.value.hint or "")
    assert not caught.value.others


def test_problems_of_all_blocks_are_reported_together(compile_text: Compile, small: str) -> None:
    text = (
        small.replace("timeout: 4 s", "timeout: 4 m")
        .replace("for: 0.1 s", "for: 0.1 A")
        .replace("default: stone", "default: ice")
    )
    with pytest.raises(ConfigError) as caught:
        compile_text(text)
    lines = [item.place.line for item in (caught.value, *caught.value.others) if item.place]
    assert len(lines) == 3
    assert lines == sorted(lines)


def test_trial_in_which_no_step_plays(compile_text: Compile, small: str) -> None:
    text = small.replace("    - step: drive\n", "    - step: drive\n      when: {floor: pvc}\n")
    with pytest.raises(ConfigError, match=r"no step .*\{'floor': 'stone'"):
        compile_text(text)
    assert compile_text(text, floor="pvc").trials


@pytest.mark.parametrize("keys", ["default:", "default: 1 A, min:"])
def test_value_from_swept_default_is_refused(compile_text: Compile, small: str, keys: str) -> None:
    text = small.replace("current: {doc: Motor current, unit: A,",
                         "current: {doc: Motor current, unit: A, default: 0.5 A,")  # fmt: skip
    text = text.replace(
        "  speed: {doc",
        f"  part: {{doc: Part, unit: A, {keys} '0.5 * ${{current}}'}}\n  speed: {{doc",
    )
    with pytest.raises(ConfigError, match=r"(?s)'\$\{current\}'.*the sweep varies current"):
        compile_text(text)


def test_difference_of_temperatures_is_no_default(compile_text: Compile, small: str) -> None:
    rise = "  rise: {doc: Rise, unit: degC, default: '${hot} - ${cold}'}\n"
    hot = "  hot: {doc: Hot, unit: degC, default: 80 degC}\n"
    text = small.replace("  speed: {doc", f"{hot}{hot.replace('hot', 'cold')}{rise}  speed: {{doc")
    with pytest.raises(ConfigError, match="rise is given as the difference of two values"):
        compile_text(text)
