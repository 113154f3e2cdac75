"""A recording evaluated with other constants than it carries."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rigd.analysis.evaluation import open_sweeps
from rigd.analysis.provenance import provenance
from rigd.analysis.recordings.corrections import Corrections, corrected
from rigd.analysis.recordings.source import RecordedSweep, open_sweep
from rigd.model.channels import Channel, Stream
from rigd.model.errors import ConfigError, DataError
from rigd.model.rows import row_dtype
from rigd.procedure.loader import parse_procedure
from rigd.record import Attachment, RecordingWriter
from rigd.sdk.shipped_files import shipped_folder
from rigd_analyses.lugre.analysis import LugreAnalysis

START_NS = 1_790_000_000_000_000_000
STREAMS = [
    Stream("wheel_encoder", (Channel("angle", "rad"),)),
    Stream("carriage", (Channel("position", "m"),)),
    Stream("accelerometer", (Channel("acceleration", "m/s^2"),)),
    Stream("wheel_servo", (Channel("current", "A"), Channel("monitor", "A"))),
]
SIGNALS = {
    "wheel_angle": "wheel_encoder.angle",
    "carriage_position": "carriage.position",
    "acceleration": "accelerometer.acceleration",
    "motor_current": "wheel_servo.current",
}
CONSTANTS = {
    "mass": 3.9593, "wheel_radius": 0.1, "guide_friction": 0.304, "rolling_resistance": "rolling",
    "gravity": 9.81,
}  # fmt: skip
RIG = (shipped_folder("configs") / "sim_lugre.yaml").read_text("utf-8")
PROCEDURE = (shipped_folder("procedures") / "constant_current.yaml").read_text("utf-8")

Record = Callable[..., RecordedSweep]


@pytest.fixture
def record(tmp_path: Path) -> Record:
    """Record two trials, on stone and PVC; the plan has what is given besides ``CONSTANTS``."""

    def write(**said: object) -> RecordedSweep:
        plan = {"signals": SIGNALS, "constants": CONSTANTS, "group_by": ["floor"], **said}
        stated = {"identify": {"model": "lugre", **{k: json.dumps(plan[k]) for k in plan}}}
        return open_sweep(write_trials(tmp_path / "run.mcap", stated))

    return write


def write_trials(path: Path, metadata: dict[str, dict[str, str]]) -> Path:
    with RecordingWriter.create(
        path,
        streams=STREAMS,
        metadata=metadata,
        attachments=(Attachment("rig.yaml", "application/yaml", RIG.encode()),),
        start_ns=START_NS,
        sync_interval_s=None,
    ) as writer:
        for number, (floor, rolling) in enumerate((("stone", 0.009), ("pvc", 0.022)), 1):
            begin = START_NS + number * 1_000_000_000
            parameters = {"floor": floor, "rolling": rolling, "current": 0.5 * number}
            units = {"rolling": "1", "current": "A"}
            writer.event(begin, "trial_start", number,
                         {"parameters": parameters, "units": units})  # fmt: skip
            for stream in STREAMS:
                rows = np.zeros(10, row_dtype(stream))
                rows["t_ns"] = begin + 1_000_000 * np.arange(10)
                writer.write(stream.name, rows)
            writer.event(begin + 10_000_000, "trial_end", number, {"complete": True})
    return path


def planned_afterwards(path: Path, text: str) -> RecordedSweep:
    """Return a recording that states no plan, with that of a procedure."""
    corrections = Corrections(procedure=parse_procedure(text, Path("p.yaml")))
    return open_sweeps([write_trials(path, {})], pytest.fail, corrections, lambda item: None)[0]


def test_a_procedure_plans_what_has_no_plan(tmp_path: Path) -> None:
    sweep = planned_afterwards(tmp_path / "run.mcap", PROCEDURE)
    assert sweep.plan.model == "lugre"
    assert sweep.plan.group_by == ("floor",)
    assert sweep.constant(sweep.trials[0], "wheel_radius") == pytest.approx(0.05)
    assert said(sweep)["signal wheel_angle"] == ("", "wheel_encoder.angle")


def test_a_group_that_no_trial_has_is_refused(tmp_path: Path) -> None:
    text = PROCEDURE.replace("group_by: [floor]", "group_by: [flor]")
    with pytest.raises(ConfigError, match=r"p\.yaml:\d+:\d+: .* 'flor'") as refused:
        planned_afterwards(tmp_path / "run.mcap", text)
    assert "did you mean 'floor'?" in str(refused.value)


def test_missing_group_is_the_only_cause_named(tmp_path: Path) -> None:
    text = PROCEDURE.replace("  floor:", "  surface:").replace("[floor]", "[surface]")
    text = text.replace("by: floor", "by: surface")
    with pytest.raises(ConfigError, match="has no trial parameter 'surface'") as refused:
        planned_afterwards(tmp_path / "run.mcap", text)
    assert refused.value.others == ()


def test_without_any_plan_the_option_is_named(tmp_path: Path) -> None:
    path = write_trials(tmp_path / "run.mcap", {})
    with pytest.raises(DataError, match="does not state what to identify") as refused:
        open_sweeps([path], pytest.fail, None, lambda item: None)
    assert "--plan" in str(refused.value.hint)


def with_procedure(sweep: RecordedSweep, text: str) -> RecordedSweep:
    return corrected(sweep, Corrections(procedure=parse_procedure(text, Path("p.yaml"))))


def said(sweep: RecordedSweep) -> dict[str, tuple[str, str]]:
    return {item.what: (item.recorded, item.used) for item in sweep.corrections}


def test_a_corrected_constant_holds_in_every_trial(record: Record) -> None:
    given = {"wheel_radius": "50 mm +- 0.2 mm", "rolling_resistance": "0.02"}
    sweep = corrected(record(), Corrections(given))
    for trial in sweep.trials:
        assert sweep.constant(trial, "wheel_radius") == pytest.approx(0.05)
        assert sweep.uncertainty(trial, "wheel_radius") == pytest.approx(2e-4)
        assert sweep.constant(trial, "rolling_resistance") == 0.02
        assert sweep.constant(trial, "mass") == 3.9593
    assert said(sweep) == {
        "wheel_radius": ("100 mm", "50 mm ± 0.2 mm"),
        "rolling_resistance": ("0.009, 0.022", "0.02"),
    }


@pytest.mark.parametrize(
    ("text", "u"),
    [("50 mm", 1e-4), ("50 mm ± 1 %", 5e-4), ("5 cm +/- 0 mm", 0.0), ("50 mm+-10 um", 1e-5)],
)
def test_a_corrected_value_keeps_or_replaces_the_uncertainty(
    record: Record, text: str, u: float
) -> None:
    recorded = {"wheel_radius": {"size": 1e-4, "is_share": False}}
    sweep = record(uncertainties=recorded, units={"wheel_radius": "mm"})
    sweep = corrected(sweep, Corrections({"wheel_radius": text}))
    assert sweep.constant(sweep.trials[0], "wheel_radius") == pytest.approx(0.05)
    assert sweep.uncertainty(sweep.trials[0], "wheel_radius") == pytest.approx(u)


def test_constant_that_was_not_recorded_can_be_given(record: Record) -> None:
    sweep = corrected(record(), Corrections({"torque_constant": "29.5 mN m/A +- 1 %"}))
    assert sweep.uncertainty(sweep.trials[0], "torque_constant") == pytest.approx(2.95e-4)
    assert said(sweep) == {"torque_constant": ("", "29.5 mN m/A ± 1 %")}


@pytest.mark.parametrize(
    ("name", "text", "parts"),
    [
        ("wheel_radios", "50 mm", ["wheel_radios", "did you mean 'wheel_radius'?"]),
        ("wheel_radius", "50 kg", ["the unit kg", "recorded in mm"]),
        ("wheel_radius", "50", ["no unit", "recorded in mm"]),
        ("wheel_radius", "", ["cannot read"]),
        ("wheel_radius", "50 mm +- 1 kg", ["kg", "expected mm or %"]),
        ("wheel_radius", "50 mm +- -1 mm", ["below 0"]),
        ("wheel_radius", "50 mm +-", ["cannot read"]),
    ],
)
def test_a_wrong_correction_is_refused(
    record: Record, name: str, text: str, parts: list[str]
) -> None:
    with pytest.raises(ConfigError) as caught:
        corrected(record(units={"wheel_radius": "mm"}), Corrections({name: text}))
    assert all(part in f"{caught.value} {caught.value.hint}" for part in (f"--set {name}", *parts))


@pytest.mark.parametrize(
    ("name", "text", "parts"),
    [
        ("guide_friction_mass", "41 N", ["the unit N", "the model takes it in kg"]),
        ("guide_friction_mass", "4200", ["no unit", "the model takes it in kg"]),
        ("torque_constant", "29.8", ["no unit", "the model takes it in N m/A"]),
        ("roller_transitions", "18 1/s", ["the unit 1/s", "the model takes it in 1"]),
        ("wheel_radius", "50", ["no unit", "the model takes it in m"]),  # recorded without a unit
    ],
)
def test_constant_not_recorded_needs_unit_of_model(
    record: Record, name: str, text: str, parts: list[str]
) -> None:
    with pytest.raises(ConfigError) as caught:
        corrected(record(), Corrections({name: text}))
    assert all(part in caught.value.message for part in (f"--set {name}={text}", *parts))


def test_analysis_without_units_takes_any_constant(
    record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LugreAnalysis, "needs", replace(LugreAnalysis.needs, constant_units={}))
    sweep = corrected(record(), Corrections({"guide_friction_mass": "4200"}))
    assert sweep.constant(sweep.trials[0], "guide_friction_mass") == 4200.0


def test_recorded_constant_of_wrong_kind_is_mended(record: Record) -> None:
    sweep = record()
    wrong = replace(sweep, plan=replace(sweep.plan, units={**sweep.plan.units, "mass": "N"}))
    mended = corrected(wrong, Corrections({"mass": "4 kg"}))
    assert mended.constant(mended.trials[0], "mass") == 4.0


def test_a_procedure_gives_constants_of_rig_and_tables(record: Record) -> None:
    text = PROCEDURE.replace("stone: 0.009, pvc: 0.022", "stone: 0.01, pvc: 0.03")
    sweep = with_procedure(record(), text)
    stone, pvc = sweep.trials
    assert sweep.constant(stone, "rolling_resistance") == 0.01
    assert sweep.constant(pvc, "rolling_resistance") == 0.03
    assert sweep.uncertainty(pvc, "rolling_resistance") == pytest.approx(0.003)
    assert sweep.constant(pvc, "wheel_radius") == pytest.approx(0.05)
    assert sweep.uncertainty(pvc, "wheel_radius") == pytest.approx(1e-4)
    assert sweep.reference(pvc)["sigma_0"] == 49.933
    assert sweep.reference(stone)["sigma_0"] == 11.451
    differences = said(sweep)
    assert differences["wheel_radius"] == ("100 mm", "50 mm ± 0.1 mm")
    assert differences["rolling_resistance"] == ("0.009, 0.022", "0.01, 0.03 ± 10 %")
    assert "gravity" in differences
    assert not any(name.startswith("signal") for name in differences)


def test_a_procedure_gives_other_signals(record: Record) -> None:
    other = PROCEDURE.replace("current: wheel_servo.current", "current: wheel_servo.monitor")
    sweep = with_procedure(record(), other)
    assert sweep.plan.signals["motor_current"] == "wheel_servo.monitor"
    assert said(sweep)["signal motor_current"] == ("wheel_servo.current", "wheel_servo.monitor")


def test_report_lists_the_corrections(record: Record) -> None:
    sweep = corrected(record(), Corrections({"wheel_radius": "50 mm"}))
    facts = provenance([sweep], [2], {}).facts[0].entries
    assert facts["corrected wheel_radius"] == "100 mm in the recording, 50 mm here"


def test_corrections_hold_above_the_procedure(record: Record) -> None:
    procedure = parse_procedure(PROCEDURE, Path("p.yaml"))
    sweep = corrected(record(), Corrections({"wheel_radius": "49 mm"}, procedure))
    assert sweep.constant(sweep.trials[0], "wheel_radius") == pytest.approx(0.049)
    assert said(sweep)["wheel_radius"] == ("100 mm", "49 mm ± 0.1 mm")


@pytest.mark.parametrize(
    ("old", "new", "parts"),
    [
        ("${rig.gravity}", "${rig.gravitation}", ["p.yaml:", "unknown name '${rig.gravitation}'"]),
        ("${rig.gravity}", "9.81 m/s^2 * ${current} / 1 A", ["the sweep varies current"]),
        ("gravity: ${rig.gravity}", "gravitation: ${rig.gravity}", ["needs the constant gravity"]),
        ("model: lugre", "model: approach-angle", ["model approach-angle", "model lugre"]),
    ],
)
def test_a_procedure_that_does_not_fit_is_refused(
    record: Record, old: str, new: str, parts: list[str]
) -> None:
    assert PROCEDURE.count(old) == 1
    with pytest.raises(ConfigError) as caught:
        with_procedure(record(), PROCEDURE.replace(old, new))
    assert all(part in str(caught.value) for part in parts)
    assert caught.value.place is not None


@pytest.mark.parametrize(
    ("channel", "part"),
    [("truth.current", "truth"), ("carriage.position", "in m; the model works from A")],
)
def test_a_signal_that_does_not_fit_is_refused(record: Record, channel: str, part: str) -> None:
    line = "motor_current: wheel_servo.current"
    assert PROCEDURE.count(line) == 1
    text = PROCEDURE.replace(line, f"motor_current: {channel}")
    with pytest.raises(DataError, match=part):
        with_procedure(record(), text)
