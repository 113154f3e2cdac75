"""Dry runs of real rigs: on the plant of a simulated sibling, and without any physics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rigd.config.loader import load_rig
from rigd.config.rig import RigConfig
from rigd.dry_run import DryRunResult, dry_run
from rigd.model import Blocked, ConfigError
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import parse_procedure
from rigd.procedure.program import CompiledProcedure, Prompt
from rigd.sdk.shipped_files import shipped_folder

CONFIGS = shipped_folder("configs")
REAL = load_rig(CONFIGS / "wire_lugre.yaml")
SIMULATED = load_rig(CONFIGS / "sim_lugre.yaml")
ALONE = replace(REAL, sibling=None)
DRIVE = """\
procedure: drive
title: Drive
doc: For tests.
trial:
  steps:
    - {step: free, set: {longitudinal_belt.engaged: 0}, for: 0.3 s}
    - step: go
      set: {wheel_servo.current: 1.2 A}
      until: carriage.position > 0.2 m
      timeout: 4 s
    - {step: still, set: {wheel_servo.current: 0 A, longitudinal_belt.engaged: 1}, for: 0.5 s}
"""


def compiled(rig: RigConfig, text: str = DRIVE) -> CompiledProcedure:
    return compile_procedure(parse_procedure(text, Path("drive.yaml")), rig)


def played(rig: RigConfig, text: str = DRIVE) -> DryRunResult:
    return dry_run(compiled(rig, text), rig, seed=1)


def changed(folder: Path, old: str, new: str, name: str = "wire_lugre.yaml") -> RigConfig:
    """Return a shipped real rig with another text in its file."""
    text = (CONFIGS / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new))
    return load_rig(folder / name)


def test_real_rig_plays_as_its_sibling_does() -> None:
    real, simulated = played(REAL), played(SIMULATED)
    assert real.physics == "sibling"
    assert real.sibling.startswith("lugre-1 (")
    assert real.refusals == ()
    assert real.steps == simulated.steps
    assert real.peaks == simulated.peaks
    assert real.duration_s == simulated.duration_s
    assert real.differences
    assert simulated.differences == ()


def test_interlock_of_real_file_refuses(tmp_path: Path) -> None:
    rig = changed(tmp_path, "high: 1.65 m", "high: 150 mm")
    found = played(rig, DRIVE.replace("> 0.2 m", "> 0.14 m"))
    assert any("interlock overrun_far (abort)" in refusal for refusal in found.refusals)
    peak = next(item for item in found.peaks if item.limit_by == "interlock overrun_far")
    assert peak.high == 0.15
    assert not peak.inside


def test_trial_that_ends_before_its_steps_is_refused() -> None:
    text = DRIVE.replace("  steps:\n", "  limits: {carriage.position: {low: 1 mm}}\n  steps:\n")
    found = played(SIMULATED, text)
    assert found.steps == ()
    assert any("trial 1 would end early" in refusal for refusal in found.refusals)


def test_rate_of_real_file_slows_the_sibling(tmp_path: Path) -> None:
    slow = changed(tmp_path, "high: 1.6 A, rate: 2000 A/s", "high: 1.6 A, rate: 1 A/s")
    found = {step.name: step for step in played(slow).steps}
    usual = {step.name: step for step in played(REAL).steps}
    assert found["go"].longest_s > usual["go"].longest_s + 0.3


def test_setpoint_beyond_the_siblings_device_refuses(tmp_path: Path) -> None:
    text = (CONFIGS / "sim_lugre.yaml").read_text()
    text = text.replace(
        "driver: sim-lugre-amplifier",
        "driver: sim-lugre-amplifier\n    options: {current_range: 1 A}",
    )
    text = text.replace("low: -1.6 A, high: 1.6 A", "low: -1 A, high: 1 A")
    (tmp_path / "sim_lugre.yaml").write_text(text)
    rig = changed(tmp_path, "rig: wire-1", "rig: wire-2")
    (refusal,) = played(rig).refusals
    assert refusal.startswith("wheel_servo.current leaves -1 A to 1 A, which the device of the sib")


def test_sensor_at_end_of_its_range_refuses() -> None:
    carriage = SIMULATED.devices["carriage"]
    (position,) = carriage.declaration.channels[:1]
    narrow = replace(
        carriage.declaration,
        row=None,
        channels=(replace(position, high=0.15), *carriage.declaration.channels[1:]),
    )
    devices = {**SIMULATED.devices, "carriage": replace(carriage, declaration=narrow)}
    short = DRIVE.replace("> 0.2 m", "> 0.14 m")
    found = played(replace(SIMULATED, devices=devices), short)
    assert found.refusals == (
        "carriage.position reaches the end of its range, 0.15 m: its peak is not known",
    )
    assert played(SIMULATED, short).refusals == ()


def test_channel_that_sibling_lacks_blocks_the_procedure() -> None:
    text = DRIVE.replace("carriage.position > 0.2 m", "traction.force > 1 N")
    with pytest.raises(Blocked, match=r"drive uses traction\.force, and the sibling has not"):
        played(REAL, text)


def test_channel_of_another_kind_blocks_the_procedure() -> None:
    text = DRIVE.replace("carriage.position > 0.2 m", "wheel_servo.current_raw > 0.5")
    with pytest.raises(Blocked, match=r"uses wheel_servo\.current_raw in 1, and"):
        played(REAL, text)


def test_derived_channel_of_lacking_one_blocks() -> None:
    text = DRIVE + "derived: {pull.double: {is: 2 * traction.force}}\n"
    with pytest.raises(Blocked, match=r"traction\.force"):
        played(REAL, text)
    text = DRIVE + "derived: {cart.double: {is: 2 * carriage.position}}\n"
    assert (
        played(REAL, text.replace("carriage.position > 0.2 m", "cart.double > 0.4 m")).refusals
        == ()
    )


SCALE = """\
procedure: weigh
title: Weigh
doc: For tests.
trial:
  steps:
    - prompt: weight
      text: Load the wheel
      unit: kg
      answer: 5 kg
      changes: load
      agrees: {with: scale.mass, within: 0.3 kg, for: 0.5 s}
      timeout: 10 s
    - {step: settled, until: scale is stable, timeout: 5 s}
"""


def test_words_of_status_are_those_of_sibling() -> None:
    rig = load_rig(CONFIGS / "wire_approach_angle.yaml")
    simulated = load_rig(CONFIGS / "sim_approach_angle.yaml")
    found = played(rig, SCALE)
    assert found.refusals == ()
    assert [step.longest_s for step in found.steps] == [
        step.longest_s for step in played(simulated, SCALE).steps
    ]


def test_setting_that_sibling_lacks_blocks() -> None:
    rig = load_rig(CONFIGS / "wire_approach_angle.yaml")
    procedure = compiled(rig, SCALE)
    prompt, *rest = procedure.trials[0].steps
    assert isinstance(prompt, Prompt)
    other = replace(prompt, changes="humidity")
    trial = replace(procedure.trials[0], steps=(other, *rest))
    with pytest.raises(Blocked, match=r"prompt 'weight': the plant of .* has no 'humidity'"):
        dry_run(replace(procedure, trials=(trial,)), rig, seed=1)


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("answer: 5 kg", "answer: 500 kg", r"drive.yaml:9:15: load cannot be 500 kg"),
        ("changes: load", "changes: laod", r"drive.yaml:10:16: the plant .* has no 'laod'"),
        ("unit: kg\n      answer: 5 kg", "unit: N\n      answer: 5 N",
         r"drive.yaml:10:16: the prompt asks for N, but load on the plant of .* takes"),
        ("unit: kg\n      answer: 5 kg", "choices: [low, high]\n      answer: low",
         r"the prompt asks for a word, but load"),
    ],
)  # fmt: skip
def test_answer_for_real_rig_fits_its_sibling(old: str, new: str, problem: str) -> None:
    rig = load_rig(CONFIGS / "wire_approach_angle.yaml")
    real = replace(rig, simulation=None)
    simulated = load_rig(CONFIGS / "sim_approach_angle.yaml")
    without = SCALE.replace("      agrees: {with: scale.mass, within: 0.3 kg, for: 0.5 s}\n", "")
    without = without.replace("      timeout: 10 s\n", "")
    assert without.count(old) == 1
    for where in (real, simulated):
        compiled(where, without)
        with pytest.raises(ConfigError, match=problem):
            compiled(where, without.replace(old, new))


def test_faults_are_left_out_with_a_note() -> None:
    fault = "    - {fault: {part: wheel_servo, fault: silent, after: 0.1 s}}\n"
    found = played(REAL, DRIVE.replace("    - step: go", f"{fault}    - step: go"))
    assert found.refusals == ()
    assert found.notes == ("1 fault is not shown: only devices at the wire do",)


def test_without_sibling_only_what_is_written() -> None:
    found = played(ALONE, DRIVE + "repeats: 3\n")
    assert found.physics == "none"
    assert found.peaks == ()
    assert found.refusals == ()
    assert found.result is None
    rows = {step.name: step for step in found.steps}
    assert (rows["free"].timing, rows["free"].longest_s) == ("known", 0.3)
    assert (rows["go"].timing, rows["go"].shortest_s, rows["go"].longest_s) == ("at_most", 0, 4)
    assert rows["go"].setpoints == ("wheel_servo.current = 1.2 A, at most 2000 A/s",)
    assert rows["go"].played == 3
    assert found.known_s == pytest.approx(3 * 0.8)
    assert found.duration_s == pytest.approx(3 * 4.8)
    assert any("nothing was played" in note for note in found.notes)
    assert any("not known: peaks" in note for note in found.notes)


def test_wait_with_end_is_bounded_without_sibling() -> None:
    text = DRIVE.replace("timeout: 4 s", "for: 2 s")
    row = next(step for step in played(ALONE, text).steps if step.name == "go")
    assert (row.timing, row.longest_s) == ("at_most", 2.0)


def test_prompts_are_counted_without_sibling() -> None:
    rig = replace(load_rig(CONFIGS / "wire_approach_angle.yaml"), sibling=None)
    found = played(rig, SCALE)
    assert "1 prompt waits for an answer: not counted" in found.notes
    assert [(step.name, step.timing) for step in found.steps] == [
        ("weight", "at_most"), ("settled", "at_most")
    ]  # fmt: skip


def test_controller_of_blocks_of_readings_is_named(tmp_path: Path) -> None:
    """The card gives readings in blocks; its stand-in gives one in each cycle."""
    held = """\
controllers:
  hold: {measured: accelerometer.acceleration, output: wheel_servo.current, kp: 0.01 A s^2/m,
         output_limits: [-1 A, 1 A], limits: {low: 0 m/s^2, high: 1 m/s^2}, stale_after: 1 s}
interlocks:
"""
    for name in ("wire_lugre", "sim_lugre"):
        text = (CONFIGS / f"{name}.yaml").read_text()
        assert "interlocks:\n" in text
        (tmp_path / f"{name}.yaml").write_text(text.replace("interlocks:\n", held))
    real = played(load_rig(tmp_path / "wire_lugre.yaml"))
    (note,) = (note for note in real.notes if note.startswith("hold: "))
    assert "readings of accelerometer come in blocks" in note
    assert "in each cycle in the sibling" in note
    assert not any("readings of" in note for note in played(REAL).notes)
    assert any(item.what == "readings of accelerometer" for item in real.differences)
