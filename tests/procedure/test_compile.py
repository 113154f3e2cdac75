"""What a procedure compiles to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from rigd.config.rig import RigConfig
from rigd.model import ConfigError
from rigd.model.limits import SetpointLimit
from rigd.model.units import parse_quantity
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure, parse_procedure
from rigd.procedure.profiles.profiles import (
    Chirp,
    ConstantProfile,
    Prbs,
    Ramp,
    Sine,
    Square,
    TableProfile,
)
from rigd.procedure.program import (
    AnswerKind,
    Comparison,
    CompiledProcedure,
    Condition,
    CycleProgram,
    Hold,
    OnClientLoss,
    OnTimeout,
    Prompt,
    Recorded,
    TrialLimit,
)

Compile = Callable[..., CompiledProcedure]


def only_program(steps: tuple[object, ...]) -> CycleProgram:
    (program,) = (step for step in steps if isinstance(step, CycleProgram))
    return program


def test_small_procedure_compiles_to_its_trials(compile_text: Compile, small: str) -> None:
    compiled = compile_text(small)
    assert compiled.parameters == {"floor": "stone", "speed": 0.1, "rolling": 0.009}
    assert compiled.units == {"current": "A", "speed": "mm/s", "rolling": "1"}
    assert [trial.parameters["current"] for trial in compiled.trials] == [0.5, 1.0, 1.5]
    assert [trial.number for trial in compiled.trials] == [1, 2, 3]

    (prompt,) = compiled.prepare
    assert prompt == Prompt(
        "floor_prompt", "Lay stone and go at 100 mm/s.", AnswerKind.CHOICE,
        choices=("stone",), answer="stone", changes="floor",
    )  # fmt: skip

    program = only_program(compiled.trials[1].steps)
    assert program.limits == (TrialLimit("carriage.position", -0.03, 1.5),)
    (drive,) = program.segments
    assert drive.setpoints == {
        "wheel_servo.current": ConstantProfile(1.0),
        "longitudinal_belt.engaged": ConstantProfile(0.0),
    }
    assert drive.until == ((Condition("carriage.position", Comparison.ABOVE, 1.0),),)
    assert (drive.duration_s, drive.timeout_s, drive.on_timeout) == (None, 4.0, OnTimeout.NEXT)

    (back,) = only_program(compiled.trials[1].after).segments
    assert back.setpoints == {"longitudinal_belt.speed": ConstantProfile(-0.1)}
    (row,) = back.until
    assert row == (
        Condition("carriage.position", Comparison.BELOW, 0.002),
        Condition("longitudinal_belt.speed", Comparison.BELOW, 0.003, magnitude=True, for_s=0.2),
    )

    every_row = Recorded()
    assert compiled.record == {
        "cycle": every_row, "wheel_servo": every_row, "truth": Recorded(10),
    }  # fmt: skip
    assert compiled.identify is not None
    assert compiled.identify.constants == {"mass": 3.9593, "rolling_resistance": 0.009}
    assert compiled.identify.group_by == ("floor",)


def test_stream_may_be_recorded_during_some_steps_only(compile_text: Compile, small: str) -> None:
    wanted = "wheel_servo: 1, truth: {every: 4, during: [drive, back]}, carriage: {during: hold}"
    compiled = compile_text(small.replace("wheel_servo: 1, truth: 10", wanted))
    assert compiled.record == {
        "cycle": Recorded(),
        "wheel_servo": Recorded(),
        "truth": Recorded(4, frozenset({"drive", "back"})),
        "carriage": Recorded(1, frozenset({"hold"})),
    }


@pytest.mark.parametrize("choice", list(OnClientLoss))
def test_procedure_decides_what_a_vanished_client_means(
    compile_text: Compile, small: str, choice: OnClientLoss
) -> None:
    assert compile_text(small).on_client_loss is OnClientLoss.STOP
    chosen = compile_text(f"{small}\non_client_loss: {choice.value}\n")
    assert chosen.on_client_loss is choice


def test_override_replaces_parameters_tables_and_sweep(compile_text: Compile, small: str) -> None:
    compiled = compile_text(small, floor="pvc", speed="0.2 m/s", current="0.7 A")
    assert compiled.parameters == {
        "floor": "pvc", "speed": 0.2, "rolling": 0.022, "current": 0.7,
    }  # fmt: skip
    assert [trial.parameters["current"] for trial in compiled.trials] == [0.7]


ABOVE = "0.4 A + 0.8 A + 0.3 A"  # 1.5000000000000002 A in binary


def test_parameter_rounded_beyond_max_is_max(compile_text: Compile, small: str) -> None:
    compiled = compile_text(small, current=ABOVE)
    assert [trial.parameters["current"] for trial in compiled.trials] == [1.5]


@pytest.mark.parametrize(
    "written",
    ["{sum}", "-({sum})", "{{square: {{amplitude: '{sum}', frequency: 1 Hz}}}}",
     "{{sine: {{offset: 0.1 A, amplitude: '{sum} - 0.1 A', frequency: 1 Hz}}}}"],
)  # fmt: skip
def test_setpoint_rounded_beyond_limit_is_limit(
    compile_text: Compile, rig: RigConfig, small: str, written: str
) -> None:
    device, limit = rig.devices["wheel_servo"], SetpointLimit(-1.5, 1.5)
    lower = replace(device, limits={**device.limits, "current": limit})
    own = replace(rig, devices={**rig.devices, "wheel_servo": lower})
    text = small.replace("wheel_servo.current: ${current}",
                         f"wheel_servo.current: {written.format(sum=ABOVE)}")  # fmt: skip
    compiled = compile_procedure(parse_procedure(text, Path("p.yaml")), own, {})
    (drive,) = only_program(compiled.trials[0].steps).segments
    profile = drive.setpoints["wheel_servo.current"]
    peaks = [abs(profile.at(t / 40, 0.0)) for t in range(41)]
    assert 1.5 - 1e-12 < max(peaks) <= 1.5


def test_trial_limit_rounded_beyond_range_is_its_end(compile_text: Compile, small: str) -> None:
    sum_ = "0.1 m + 1.1 m + 0.6 m"  # 1.8000000000000003 m in binary
    compiled = compile_text(small.replace("high: 1.5 m", f"high: {sum_}"))
    (limit,) = only_program(compiled.trials[0].steps).limits
    assert limit.high == 1.8


def test_repeats_are_trials_of_their_own(compile_text: Compile, small: str) -> None:
    compiled = compile_text(small.replace("prepare:", "repeats: 2\n\nprepare:", 1))
    shown = [(trial.number, trial.repeat, trial.parameters["current"]) for trial in compiled.trials]
    assert shown == [(1, 1, 0.5), (2, 2, 0.5), (3, 1, 1.0), (4, 2, 1.0), (5, 1, 1.5), (6, 2, 1.5)]


def test_random_order_is_permutation_that_seed_repeats(compile_text: Compile, small: str) -> None:
    def numbers(seed: int) -> list[int]:
        text = small.replace("sweep:", f"repeats: 5\nsweep:\n  order: random\n  seed: {seed}", 1)
        return [trial.number for trial in compile_text(text).trials]

    assert sorted(numbers(1)) == list(range(1, 16))
    assert numbers(1) == numbers(1)
    assert numbers(1) != numbers(2)
    assert numbers(1) != sorted(numbers(1))


def test_grid_is_combined_with_rows_of_zip(compile_text: Compile, small: str) -> None:
    text = small.replace(
        "  grid:\n    current: {from: 0.5 A, to: 1.5 A, step: 0.5 A}",
        "  grid:\n    floor: [pvc, stone]\n"
        "  zip:\n    current: [1 A, 0.5 A]\n    speed: [10 mm/s, 2 cm/s]",
    ).replace("Lay ${floor} and go at ${speed}.", "Go.").replace(
        'choices: ["${floor}"]\n    answer: ${floor}\n    changes: floor', ""
    )  # fmt: skip
    points = [
        tuple(trial.parameters[name] for name in ("floor", "current", "speed", "rolling"))
        for trial in compile_text(text).trials
    ]
    assert points == [
        ("pvc", 1.0, 0.01, 0.022), ("pvc", 0.5, 0.02, 0.022),
        ("stone", 1.0, 0.01, 0.009), ("stone", 0.5, 0.02, 0.009),
    ]  # fmt: skip
    compiled = compile_text(text)
    assert compiled.identify is not None
    # The sweep varies the floor: the constant is the trial parameter of this name.
    assert compiled.identify.constants["rolling_resistance"] == "rolling"


def test_range_ends_at_value_as_written(compile_text: Compile, small: str) -> None:
    text = small.replace("speed: {doc: Belt speed, unit: mm/s, default: 100 mm/s, max: 1 m/s}",
                         "spin: {doc: Spin, unit: rpm, max: 1000 rpm}")  # fmt: skip
    text = text.replace("${speed}", "100 mm/s").replace("go at 100 mm/s", "go")
    text = text.replace(
        "  grid:\n", "  grid:\n    spin: {from: 0 rpm, to: 1000 rpm, step: 500 rpm}\n"
    )
    assert (
        max(trial.parameters["spin"] for trial in compile_text(text).trials)
        == parse_quantity("1000 rpm").value
    )


def test_speed_over_radius_is_angular_speed(compile_text: Compile, small: str) -> None:
    omega = "omega: {doc: Spin, unit: rad/s, default: '${speed} / ${rig.wheel_radius}'}"
    text = small.replace("tables:", f"  {omega}\ntables:")
    assert compile_text(text).parameters["omega"] == pytest.approx(0.1 / 0.05)


def test_interlock_with_delay_leaves_condition_reachable(compile_text: Compile, small: str) -> None:
    until = "until: wheel_servo.current > 1.9 A"
    text = small.replace("until: carriage.position > 1 m", until)
    (program, *_) = compile_text(text).trials[0].steps
    assert isinstance(program, CycleProgram)
    above = Condition("wheel_servo.current", Comparison.ABOVE, 1.9)
    assert program.segments[0].until == ((above,),)


def test_range_gives_decimal_values(compile_text: Compile, small: str) -> None:
    text = small.replace("{from: 0.5 A, to: 1.5 A, step: 0.5 A}",
                         "{from: 0.15 A, to: 1.5 A, step: 0.15 A}")  # fmt: skip
    values = [trial.parameters["current"] for trial in compile_text(text).trials]
    assert values == [0.15, 0.3, 0.45, 0.6, 0.75, 0.9, 1.05, 1.2, 1.35, 1.5]


def test_or_gives_alternatives_and_binds_more_tightly(compile_text: Compile, small: str) -> None:
    text = small.replace(
        "until: carriage.position > 1 m",
        "until: carriage.position > 1 m and wheel_servo.current < 1 A or carriage.position > 1.2 m",
    )
    (program,) = compile_text(text).trials[0].steps
    assert isinstance(program, CycleProgram)
    rows = [[condition.channel for condition in row] for row in program.segments[0].until]
    assert rows == [["carriage.position", "wheel_servo.current"], ["carriage.position"]]


@pytest.mark.parametrize(
    ("source", "profile"),
    [
        ("{ramp: {to: 1 A, over: 2 s}}", Ramp(None, 1.0, 2.0)),
        ("{ramp: {from: 1 A, to: 0 A, over: 200 ms}}", Ramp(1.0, 0.0, 0.2)),
        ("{sine: {amplitude: 0.5 A, frequency: 2 Hz}}", Sine(0.5, 2.0)),
        ("{square: {amplitude: 1 A, frequency: 2 Hz, offset: 0.1 A}}", Square(1.0, 2.0, 0.1)),
        ("{chirp: {amplitude: 1 A, from: 1 Hz, to: 20 Hz, over: 4 s, spacing: logarithmic}}",
         Chirp(1.0, 1.0, 20.0, 4.0, logarithmic=True)),
        ("{prbs: {amplitude: 1 A, bit: 20 ms, order: 7, seed: 3}}", Prbs(1.0, 0.02, 7, seed=3)),
        ("{table: {times: [0 s, 1 s], values: [0 A, 1 A], hold: true}}",
         TableProfile((0.0, 1.0), (0.0, 1.0), hold=True)),
    ],
)  # fmt: skip
def test_profile_text_compiles_to_its_profile(
    compile_text: Compile, small: str, source: str, profile: object
) -> None:
    text = small.replace("wheel_servo.current: ${current}", f"wheel_servo.current: {source}")
    (drive,) = only_program(compile_text(text).trials[0].steps).segments
    assert drive.setpoints["wheel_servo.current"] == profile


def test_when_selects_steps_by_parameter(rig: RigConfig) -> None:
    compiled = compile_procedure(load_procedure("recommended_identification"), rig)
    names = [
        [segment.name for segment in only_program(trial.steps).segments[2:]]
        for trial in compiled.trials
    ]
    changing = [["drive to the change", "drive on"]] * 4
    assert names == changing + [["drive"]] * 2 + [["drive a ramp"]] * 3 + [["swing"]] * 2


FLOORS = """\
procedure: floors
title: Floors
doc: For tests.
parameters:
  floor: {doc: Floor, choices: [stone, pvc]}
  turn: {doc: Number of the turn}
sweep: {grid: {turn: [1, 2, 3, 4], floor: [stone, pvc]}}
trial:
  steps:
    - {prompt: lay_stone, text: Lay stone., when: {floor: stone}, once_per: floor, choices: [done],
       answer: done}
    - {prompt: lay_pvc, text: Lay pvc., when: {floor: pvc}, once_per: floor, choices: [done],
       answer: done}
    - {step: wait, for: 1 s}
"""


@pytest.mark.parametrize("order", ["order: given", "order: random, seed: 3"])
def test_prompt_hidden_by_when_is_due_again(compile_text: Compile, order: str) -> None:
    text = FLOORS.replace("floor: [stone, pvc]}}", f"floor: [stone, pvc]}}, {order}}}")
    trials = compile_text(text).trials
    floors = [str(trial.parameters["floor"]) for trial in trials]
    changes = [a != b for a, b in zip(floors, ["", *floors], strict=False)]
    asked = [[step.name for step in trial.steps if isinstance(step, Prompt)] for trial in trials]
    assert asked == [[f"lay_{floor}"] if new else []
                     for floor, new in zip(floors, changes, strict=True)]  # fmt: skip


def masses_asked(compiled: CompiledProcedure) -> list[tuple[int, object]]:
    return [
        (trial.number, step.answer)
        for trial in compiled.trials
        for step in trial.steps
        if isinstance(step, Prompt)
    ]


def test_prompt_once_per_value(rig: RigConfig) -> None:
    procedure = load_procedure("validation_masses")
    compiled = compile_procedure(procedure, rig)
    assert masses_asked(compiled) == [(1, 3.9593), (9, 2.9593), (17, 1.9593)]
    # Resumed after trial 10: the operator is asked for the weights again.
    resumed = compile_procedure(procedure, rig, done=range(1, 11))
    assert (11, 2.9593) in masses_asked(resumed)
    assert compiled.identify is not None
    assert compiled.identify.constants["mass"] == "mass"


@pytest.mark.parametrize(
    ("name", "trials"),
    [
        ("quick", 1),
        ("constant_current", 10),
        ("lateral_sweep", 32),
        ("recommended_identification", 11),
        ("validation_masses", 24),
    ],
)
def test_shipped_procedures_compile_with_all_streams(
    rig: RigConfig, name: str, trials: int
) -> None:
    compiled = compile_procedure(load_procedure(name), rig)
    assert len(compiled.trials) == trials
    assert compiled.record == dict.fromkeys([*rig.devices, "cycle"], Recorded())


def test_published_values_follow_the_floor(compile_text: Compile, small: str) -> None:
    text = small + (
        "  reference:\n    label: Table I\n    by: floor\n"
        "    values:\n      stone: {V_s: 1.9 m/s}\n      pvc: {V_s: 4.4 mm/s}\n"
    )
    for floor, value in (("stone", 1.9), ("pvc", 0.0044)):
        plan = compile_text(text, floor=floor).identify
        assert plan is not None
        assert (plan.reference, plan.reference_label) == ({"V_s": value}, "Table I")
    head, _, rest = text.partition("prepare:")
    grid = head.replace("grid:\n", "grid:\n    floor: [stone, pvc]\n")
    swept = compile_text(f"{grid}trial:{rest.partition('trial:')[2]}")
    assert swept.identify is not None
    assert swept.identify.reference == {"stone.V_s": 1.9, "pvc.V_s": 0.0044}
    with pytest.raises(ConfigError, match="'ice' is not a choice of floor"):
        compile_text(text.replace("      pvc: {V_s", "      ice: {V_s"))


def test_text_of_a_procedure_travels(rig: RigConfig) -> None:
    procedure = load_procedure("quick")
    again = parse_procedure(procedure.file.text, Path("elsewhere.yaml"))
    assert compile_procedure(again, rig) == compile_procedure(procedure, rig)


def test_hold_of_step_has_setpoints_and_longest_time(compile_text: Compile, small: str) -> None:
    hold = (
        "hold: {set: {longitudinal_belt.engaged: rest, wheel_servo.current: 0.1 A}, timeout: 1 min}"
    )
    compiled = compile_text(small.replace("on_timeout: next", f"on_timeout: next\n      {hold}"))
    (drive,) = only_program(compiled.trials[0].steps).segments
    assert drive.hold == Hold(
        {"longitudinal_belt.engaged": 1.0, "wheel_servo.current": 0.1}, longest_s=60.0
    )
    assert only_program(compiled.trials[0].after).segments[0].hold is None
