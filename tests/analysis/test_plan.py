"""What a plan of identification must give, by model; and options that a model has no use for."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from support.approach_angle.recording import CONSTANTS, SIGNALS

from rigd.analysis import Options
from rigd.analysis.evaluation import evaluate
from rigd.analysis.plan import analysis_of, find_analysis, of_kind
from rigd.config.loader import load_rig
from rigd.config.registry import ANALYSES, installed
from rigd.daemon.execute import RunRequest, execute
from rigd.model.errors import ConfigError
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure, parse_procedure
from rigd.procedure.program import IdentifyPlan

PLAN = IdentifyPlan(
    model="approach-angle",
    signals=SIGNALS,
    constants=CONSTANTS,
    group_by=("set",),
    reference={"clean_0.maximum": 0.1868},
)


def test_approach_angle_plan_may_have_fast_load_cell() -> None:
    assert "normal_force_scale" not in analysis_of(PLAN).needs.calibration(PLAN.signals)
    loaded = replace(PLAN, signals={**SIGNALS, "normal_force": "daq.normal_force_raw"})
    assert {"torque_scale", "normal_force_scale"} <= set(
        analysis_of(loaded).needs.calibration(loaded.signals)
    )


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        (replace(PLAN, signals={k: v for k, v in SIGNALS.items() if k != "relay"}),
         "needs the signal relay"),
        (replace(PLAN, signals={**SIGNALS, "normal_forse": "daq.x"}), "no signal 'normal_forse'"),
        (replace(PLAN, constants={"angle": "angle"}), "needs the constant wheel_radius"),
        (replace(PLAN, reference={"clean_0.maximun": 0.2}), "no reference 'maximun'"),
    ],
)  # fmt: skip
def test_a_plan_that_lacks_something_is_refused(plan: IdentifyPlan, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        analysis_of(plan)


def test_model_without_constants_says_there_are_none() -> None:
    analysis = find_analysis("relay")
    plan = IdentifyPlan(
        model="relay", signals={name: f"a.{name}" for name in analysis.needs.signals},
        constants={"mass": "1 kg"}, group_by=(), reference={},
    )  # fmt: skip
    with pytest.raises(ConfigError) as caught:
        analysis_of(plan)
    assert caught.value.hint == "there are none"


def test_signal_that_is_not_recorded_is_refused() -> None:
    streams = {channel.partition(".")[0] for channel in SIGNALS.values()}
    analysis_of(PLAN, recorded=streams)
    channel = SIGNALS["relay"]
    with pytest.raises(ConfigError, match=f"needs .*{channel}.*, which 'record' leaves out"):
        analysis_of(PLAN, recorded=streams - {channel.partition(".")[0]})


def test_trials_need_the_parameters_that_the_campaign_varies() -> None:
    analysis_of(PLAN, trial_parameters=("set", "load", "voltage"))
    with pytest.raises(ConfigError, match="with a parameter 'voltage'"):
        analysis_of(PLAN, trial_parameters=("set", "load"))


def test_signals_are_of_kind_that_model_works_from() -> None:
    rig = load_rig("angle-1")
    analysis_of(PLAN, rig=rig)
    converted = replace(PLAN, signals={**SIGNALS, "gauge_b": "daq.gauge_b"})
    with pytest.raises(ConfigError, match=r"gauge_b is daq\.gauge_b, in 1; .* from V") as caught:
        analysis_of(converted, rig=rig)
    assert caught.value.hint == "did you mean 'daq.gauge_b_raw'?"
    converted = replace(PLAN, signals={**SIGNALS, "gauge_b": "relay.closed"})
    with pytest.raises(ConfigError, match="gauge_b is relay") as caught:
        analysis_of(converted, rig=rig)
    assert str(caught.value).splitlines()[1:] == ["  choose a channel in V"]


def test_shipped_analyses_know_units_of_constants() -> None:
    for model in installed(ANALYSES):
        if not find_analysis(model).__module__.startswith("rigd_analyses."):
            continue
        needs = find_analysis(model).needs
        assert set(needs.constant_units) == {*needs.constants, *needs.optional_constants}, model


@pytest.mark.parametrize(
    ("procedure", "rig"),
    [
        ("approach_angles", "angle-1"),
        ("calibrate_friction", "angle-1"),
        ("calibrate_load_cell", "angle-cell-1"),
        ("calibrate_rise", "angle-1"),
        ("calibrate_scale", "angle-1"),
        ("calibrate_torque", "angle-1"),
        ("circles", "articulated-1"),
        ("constant_current", "lugre-1"),
        ("lateral_sweep", "lugre-1"),
        ("validation_masses", "lugre-1"),
    ],
)
def test_shipped_procedures_give_constants_in_these_units(procedure: str, rig: str) -> None:
    plan = compile_procedure(load_procedure(procedure), load_rig(rig), {}).identify
    assert plan is not None
    needs = find_analysis(plan.model).needs
    assert plan.units
    for name, unit in plan.units.items():
        assert of_kind(unit, needs.constant_units[name]), f"{name} in {unit}"


@pytest.mark.parametrize(
    ("written", "kind"),
    [
        ("mass: 4 N", "mass has the unit N; model lugre takes it in kg"),
        ("mass: 4", "mass has no unit; model lugre takes it in kg"),
        ("mass: ${current}", "mass has the unit A; model lugre takes it in kg"),
        ("rolling_resistance: 4 mm",
         "rolling_resistance has the unit mm; model lugre takes it in a plain number"),
    ],
)  # fmt: skip
def test_constant_of_wrong_kind_is_refused(written: str, kind: str) -> None:
    text = load_procedure("constant_current").file.text
    name = written.partition(":")[0]
    text = re.sub(rf"^    {name}: .*$", f"    {written}", text, flags=re.MULTILINE)
    rig = load_rig("lugre-1")
    plan = compile_procedure(parse_procedure(text, Path("p.yaml")), rig).identify
    assert plan is not None
    with pytest.raises(ConfigError, match=f"the constant {kind}"):
        analysis_of(plan)


def test_a_model_of_converted_values_takes_no_calibration(tmp_path: Path) -> None:
    rig, source = load_rig("lugre-1"), load_procedure("constant_current")
    procedure = compile_procedure(source, rig, {"current": "1.5 A"})
    path = tmp_path / "one.mcap"
    execute(RunRequest(procedure, source.file.text, rig, 1, output=path))
    with pytest.raises(ConfigError, match=r"lugre .*converted values"):
        evaluate([path], Options(calibration=tmp_path / "other.yaml"))
