"""A run with derived channels of its procedure: played, recorded, resumed, and tried dry."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from rigd.config.loader import load_rig, parse_rig
from rigd.daemon.execute import RunRequest, perform
from rigd.daemon.resume import read_resume_point
from rigd.dry_run import dry_run
from rigd.engine.play.control import Control
from rigd.engine.run.result import Progress
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.record import Recording

RIG = load_rig("lugre-1")
TEXT = """\
procedure: far
title: Drive until the doubled way is too long
doc: For tests.
parameters:
  way: {doc: Doubled way, unit: mm, default: 20 mm}
derived:
  cart.twice: {is: 2 * carriage.position}
  cart.over: {is: "cart.twice - ${way}"}
  cart.time: {is: "integral(where(cart.twice > -1 km, 1, 1))", reset: trial}
repeats: 2
trial:
  steps:
    - step: drive
      set: {wheel_servo.current: 0.6 A, longitudinal_belt.engaged: 0}
      until: cart.over > 0 m
      timeout: 5 s
    - step: hold
      set: {longitudinal_belt.engaged: 1}
      for: 5 ms
  after:
    - step: back
      set:
        wheel_servo.current: 0 A
        longitudinal_belt.engaged: 1
        longitudinal_belt.speed: -0.1 m/s
      until: cart.twice < 2 mm
      timeout: 5 s
"""


def request(path: Path, **overrides: str) -> RunRequest:
    procedure = compile_procedure(parse_procedure(TEXT, Path("far.yaml")), RIG, overrides)
    return RunRequest(procedure, TEXT, RIG, 1, output=path, overrides=overrides)


def test_step_ends_in_cycle_that_sees_it(tmp_path: Path) -> None:
    run = perform(request(tmp_path / "far.mcap", way="30 mm"), Control())
    assert run.result.exit_code == 0, run.result.reason
    recording = Recording.open(run.path)
    for number in (1, 2):
        trial = recording.trial(number)
        cart, carriage = trial["cart"], trial["carriage"]
        assert np.array_equal(cart["twice"], 2 * carriage["position"])
        assert np.allclose(cart["over"], cart["twice"] - 0.03)
        engaged = trial["longitudinal_belt"]["engaged_setpoint"]
        sees = int(np.argmax(cart["over"] > 0))
        assert engaged[sees - 1] == 0 < engaged[sees]
        assert cart["time"].min() < 2e-3
    assert recording.streams["cart"].channels[1].unit == "m"


def test_stopped_run_resumes_with_its_channels(tmp_path: Path) -> None:
    control, path = Control(), tmp_path / "far.mcap"

    def end(progress: Progress) -> None:
        if progress.trial is not None:
            control.end_after_trial("one is enough")

    perform(request(path, way="30 mm"), control, watch=end)
    assert Recording.open(path).info.trials_done == 1
    point = read_resume_point(path)
    rest = compile_procedure(
        parse_procedure(TEXT, Path("far.yaml")), RIG, point.overrides, done=point.done
    )
    resumed = replace(
        request(path), procedure=rest, resume=point, overrides=point.overrides, output=None
    )
    assert perform(resumed, Control()).result.exit_code == 0
    recording = Recording.open(path)
    assert [trial.complete for trial in recording.trials] == [True, True]
    cart = recording.trial(2)["cart"]
    assert np.allclose(cart["over"], cart["twice"] - 0.03)


def test_dry_run_ends_where_the_run_does(tmp_path: Path) -> None:
    made = request(tmp_path / "far.mcap")
    found = dry_run(made.procedure, RIG, seed=1)
    assert not found.refusals
    assert found.steps[0].ends[0] == "cart.over > 0 m"
    run = perform(made, Control())
    seconds = Recording.open(run.path).info.duration_s
    assert abs(found.duration_s - seconds) < 0.1


def test_rig_with_controller_keeps_its_channels_apart(tmp_path: Path) -> None:
    text = RIG.source.text.replace(
        "interlocks:\n",
        "derived:\n  own.way: {is: 3 * carriage.position}\n"
        "controllers:\n  hold: {measured: wheel_servo.current, output: lateral_belt.speed, "
        "kp: 1 m/(A s), output_limits: [-0.1 m/s, 0.1 m/s]}\ninterlocks:\n",
        1,
    )
    rig = parse_rig(text, RIG.source.path)
    procedure = compile_procedure(parse_procedure(TEXT, Path("far.yaml")), rig)
    run = perform(RunRequest(procedure, TEXT, rig, 1, output=tmp_path / "far.mcap"), Control())
    recording = Recording.open(run.path)
    assert list(recording.streams)[-4:] == ["own", "hold", "cart", "cycle"]
    position = recording.read("carriage")["position"]
    assert np.array_equal(recording.read("own")["way"], 3 * position)
    assert np.array_equal(recording.read("cart")["twice"], 2 * position)
    assert not np.any(recording.read("hold")["error"])  # it does not act
