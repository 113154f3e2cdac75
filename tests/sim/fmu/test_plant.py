"""An FMU as a plant: what it computes, and how a run ends if it fails."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from rigd.cli.main import main
from rigd.model.errors import ConfigError, DeviceError, Exit
from rigd.record.read.reader import Recording
from rigd.sdk.check import check_plant
from rigd_sim.fmu.device import FmuDevice, FmuDeviceConfig
from rigd_sim.fmu.plant import FmuConfig, FmuPlant
from rigd_sim.fmu.process import FmuProcess

MS = 1_000_000
RPM = 0.10471975511965977
OPTIONS: dict[str, Any] = {
    "inputs": {"torque": "torque"},
    "outputs": {"speed": {"variable": "speed", "unit": "rad/s"}, "steps": "steps",
                "temperature": {"variable": "temperature", "unit": "K"}},
}  # fmt: skip
RIG = """\
rig: fmu-1
title: a flywheel in an FMU
cycle: 1 kHz
plant: {model: fmu, file: FILE, deadline: 0.5 s, start: {fault: FAULT, after: 50 ms}}
devices:
  bench:
    driver: sim-fmu
    options:
      inputs: {torque: torque}
      outputs:
        speed: {variable: speed, unit: rad/s}
        temperature: {variable: temperature, unit: K}
    limits:
      torque: {low: -1 N m, high: 1 N m, rate: 100 N m/s}
interlocks: []
"""
PROCEDURE = """\
procedure: spin
title: Spin the flywheel
doc: Until it turns with 1 rad/s.
trial:
  steps:
    - step: spin
      set: {bench.torque: 0.5 N m}
      until: bench.speed > 1 rad/s
      timeout: 1 s
"""


def config_of(fmu: Path, **options: Any) -> FmuConfig:
    return FmuConfig.model_validate({"file": str(fmu), **options})


def bench(fmu: Path, period_ns: int = MS, **options: Any) -> tuple[FmuPlant, FmuDevice]:
    config = config_of(fmu, **options)
    plant = FmuPlant(config, period_ns=period_ns, seed=1)
    wired = FmuDeviceConfig.model_validate(OPTIONS, context={"plant": config})
    return plant, FmuDevice(wired, plant)


def test_steps_follow_time_and_units_are_si(flywheel: Path) -> None:
    plant, device = bench(flywheel, start={"inertia": "0.1 kg m^2"}, steps="4")
    assert list(device.read(7 * MS)) == [0.0, 0.0, 293.15]
    device.write([0.5])
    speed, steps, _ = device.read(107 * MS)
    assert steps == 400
    assert speed == pytest.approx(0.5 / 0.1 * 0.1, rel=1e-12)
    plant.close()


def test_safe_input_is_given_before_the_first_setpoint(flywheel: Path) -> None:
    config = config_of(flywheel)
    plant = FmuPlant(config, period_ns=MS, seed=1)
    options = {
        "inputs": {"torque": {"variable": "torque", "safe": "1 N m"}},
        "outputs": {"w": "omega"},
    }
    device = FmuDevice(FmuDeviceConfig.model_validate(options, context={"plant": config}), plant)
    device.read(0)
    assert device.read(10 * MS)[0] == pytest.approx(10 * 1e-3 / 0.05)
    device.write([0.0])
    device.make_safe()
    assert device.read(20 * MS)[0] == pytest.approx(20 * 1e-3 / 0.05)
    plant.close()


def test_setpoint_beyond_the_range_is_clipped(flywheel: Path) -> None:
    plant, device = bench(flywheel)
    device.read(0)
    device.write([1e9])
    assert plant.inputs == [2.0]
    with pytest.raises(DeviceError, match="NaN"):
        device.write([float("nan")])
    plant.close()


def test_plant_keeps_the_promises_that_apply(flywheel: Path) -> None:
    report = check_plant(FmuPlant, {"file": str(flywheel)}, devices={"bench": (FmuDevice, OPTIONS)})
    assert set(report.skipped) == {
        "settings from the start", "energy balances", "friction takes", "passive", "halved step",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("crash", "the step at 0.05 s crashed: its process was ended by SIGSEGV"),
        ("exit", "the step at 0.05 s crashed: its process ended by itself (exit code 3)"),
        ("hang", "the step at 0.05 s did not return within 0.5 s"),
        ("sleep", "the step at 0.05 s did not return within 0.5 s"),
        ("error", "doStep at 0.05 s returned fatal; the FMU reports: "),
        ("discard", "doStep at 0.05 s returned discard"),
        ("nan", "'temperature' is nan after 0.051 s"),
    ],
)
def test_failing_unit_ends_the_run_with_its_name(
    flywheel: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], fault: str, said: str
) -> None:
    done = play(flywheel, tmp_path, fault)
    assert done == Exit.TRIPPED
    assert f"bench: Flywheel.fmu: {said}" in capsys.readouterr().out


def test_recording_states_what_the_unit_is(flywheel: Path, tmp_path: Path) -> None:
    assert play(flywheel, tmp_path, "none") == Exit.OK
    recording = Recording.open(tmp_path / "run.mcap")
    texts = {name: item.data.decode() for name, item in recording.attachments.items()}
    facts = texts["Flywheel.fmu.yaml"]
    assert 'fmi: "3.0"' in facts and "PythonFMU3" in facts and "sha256" in facts
    assert '"after": "0.05 s"' in facts
    assert "<fmiModelDescription" in texts["Flywheel.fmu.xml"]


def play(fmu: Path, folder: Path, fault: str) -> int:
    (folder / "rig.yaml").write_text(RIG.replace("FILE", str(fmu)).replace("FAULT", fault))
    (folder / "spin.yaml").write_text(PROCEDURE)
    return main(
        ["run", str(folder / "spin.yaml"), "--rig", str(folder / "rig.yaml"),
         "--output", str(folder / "run.mcap")]
    )  # fmt: skip


def test_step_that_divides_no_cycle_is_refused(flywheel: Path) -> None:
    with pytest.raises(ConfigError, match="3 steps do not divide a cycle of 1000000 ns"):
        bench(flywheel, steps="3")


def test_process_and_files_end_with_the_plant(flywheel: Path) -> None:
    plant, _ = bench(flywheel)
    child, folder = plant._process._child.pid, plant._process.folder
    assert Path(folder).exists()
    del plant, _
    assert not Path(folder).exists()
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)


def test_file_changed_since_its_check_is_refused(flywheel: Path, tmp_path: Path) -> None:
    path = tmp_path / "copy.fmu"
    path.write_bytes(flywheel.read_bytes())
    checked = config_of(path).fmu
    path.write_bytes(flywheel.read_bytes() + bytes(1))
    with pytest.raises(DeviceError, match="the file has changed since it was checked"):
        FmuProcess(checked, (), step_ns=MS, setup_s=60.0, deadline_s=5.0)
