"""What is wrong in an FMU, or in what a rig file makes of it, is named with its place."""

from __future__ import annotations

import shutil
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from rigd.config.loader import load_rig
from rigd.config.rig import RigConfig
from rigd.model.errors import ConfigError
from rigd_sim.fmu import description

RIG = """\
rig: fmu-1
title: a flywheel in an FMU
cycle: 1 kHz
plant:
  model: fmu
  file: FILE
  deadline: 1 s
  start: {inertia: 0.1 kg m^2}
devices:
  bench:
    driver: sim-fmu
    options:
      inputs:
        torque: torque
        braked: {variable: braked, safe: 1}
      outputs:
        speed: {variable: speed, unit: rad/s}
        omega: omega
        temperature: {variable: temperature, unit: K}
        steps: steps
    limits:
      torque: {low: -1 N m, high: 1 N m, rate: 100 N m/s}
      braked: {low: 0, high: 1, rate: 1000 1/s, rest: 1}
interlocks: []
"""


def rig_of(fmu: Path, folder: Path, old: str = "", new: str = "") -> RigConfig:
    assert old in RIG
    text = RIG.replace(old, new) if old else RIG
    path = folder / "rig.yaml"
    path.write_text(text.replace("FILE", str(fmu)))
    return load_rig(path)


def refusal(fmu: Path, folder: Path, old: str = "", new: str = "") -> str:
    with pytest.raises(ConfigError) as caught:
        rig_of(fmu, folder, old, new)
    return str(caught.value)


def test_channels_have_units_and_ranges_of_the_unit(flywheel: Path, tmp_path: Path) -> None:
    device = rig_of(flywheel, tmp_path).devices["bench"]
    assert [(item.name, item.unit) for item in device.channels] == [
        ("speed", "rad/s"), ("omega", "rad/s"), ("temperature", "K"), ("steps", "1"),
    ]  # fmt: skip
    torque, braked = device.setpoints
    assert (torque.unit, torque.low, torque.high) == ("N m", -2.0, 2.0)
    assert braked.unit == "1"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("torque: torque", "torque: torqe", "14:17: Flywheel.fmu has no variable 'torqe'"),
        ("omega: omega", "omega: torque", "18:16: 'torque' is no output of the FMU"),
        ("torque: torque", "torque: omega", "14:17: 'omega' is no input of the FMU"),
        ("unit: rad/s", "unit: N", "'rpm', which is no unit of the kind of N"),
        ("unit: K", "unit: degC", "19:52: channel 'temperature': degC is not an SI unit"),
        ("omega: omega", "omega: speed", "'rpm', which is no SI unit"),
        ("omega: omega", "omega: number", "the unit 'furlong', which rigd cannot read"),
        ("braked: {variable: braked", "braked: {variable: free", "the FMU gives 'free' no unit"),
        ("omega: omega", "omega: words", "'words' is a String; a channel is a number"),
        ("safe: 1", "safe: 1 N", "15:42: '1 N' is in N, expected 1"),
        ("torque: torque", "torque: {variable: torque, safe: 3 N m}", "-2 to 2 N m"),
        ("torque: torque", "torque: {variable: torque, low: 3 A}", "'3 A' is in A, expected N m"),
        ("inertia: 0.1 kg m^2", "inertia: 0.1", "8:20: 0.1 has no unit"),
        ("inertia: 0.1 kg m^2", "inertia: 0.1 kg", "'0.1 kg' is in kg, the FMU takes 'kg.m2'"),
        ("inertia: 0.1 kg m^2", "inertia: 20 kg m^2", "the FMU takes 0.001 to 10 kg.m2"),
        ("inertia: 0.1 kg m^2", "inertias: 1", "did you mean 'inertia'?"),
        ("inertia: 0.1 kg m^2", "steps: 3", "'steps' takes no value"),
        ("inertia: 0.1 kg m^2", "braked: 3", "'braked' is true or false, found '3'"),
        ("inertia: 0.1 kg m^2", "fault: setup-error", "6:9: Flywheel.fmu: exitInitializationMode"),
        (
            "inertia: 0.1 kg m^2",
            "fault: setup-crash",
            "set-up crashed: its process was ended by SI",
        ),
        ("model: fmu", "model: lugre", "unknown key 'file'"),
    ],
)
def test_wrong_entry_is_named_with_its_place(
    flywheel: Path, tmp_path: Path, old: str, new: str, said: str
) -> None:
    assert said in refusal(flywheel, tmp_path, old, new)


def test_set_up_that_never_returns_is_refused(flywheel: Path, tmp_path: Path) -> None:
    told = refusal(
        flywheel, tmp_path, "  deadline: 1 s\n  start: {inertia: 0.1 kg m^2}",
        "  set_up: 0.5 s\n  start: {fault: setup-hang}",
    )  # fmt: skip
    assert "set-up did not return within 0.5 s" in told


def test_device_without_an_fmu_is_refused(flywheel: Path, tmp_path: Path) -> None:
    block = RIG[RIG.index("plant:") : RIG.index("devices:")]
    told = refusal(flywheel, tmp_path, block, "").replace("\n", " ")
    assert "sim-fmu stands on a plant with 'model: fmu', and this rig has no plant" in told


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('fmiVersion="3.0"', 'fmiVersion="1.0"', "of FMI 1.0; rigd takes FMI 2 and 3"),
        ("CoSimulation", "ModelExchange", "is for model exchange only"),
        ("<Float64", "<Float64 <", "its modelDescription.xml cannot be read"),
    ],
)
def test_unit_that_cannot_be_simulated_is_named(
    changed: Callable[..., Path], tmp_path: Path, old: str, new: str, said: str
) -> None:
    told = refusal(changed(old, new), tmp_path)
    assert told.partition(": ")[0].endswith("rig.yaml:6:9")
    assert said in told


def test_binaries_of_another_platform_are_listed(
    changed: Callable[..., Path], tmp_path: Path
) -> None:
    def moved(name: str) -> str | None:
        return name.replace("x86_64-linux", "riscv64-linux") if "windows" not in name else None

    told = refusal(changed("<", "<", name=moved), tmp_path)
    assert "for this machine; it has binaries for" in told
    assert "riscv64-linux" in told


def test_file_without_a_description_is_no_fmu(changed: Callable[..., Path], tmp_path: Path) -> None:
    path = changed("<", "<", name=lambda name: None if name.startswith("model") else name)
    assert "has no modelDescription.xml: it is no FMU" in refusal(path, tmp_path)


def test_file_that_is_no_zip_is_named(tmp_path: Path) -> None:
    path = tmp_path / "changed.fmu"
    path.write_text("not a zip")
    assert "rig.yaml:6:9: changed.fmu is not a zip file" in refusal(path, tmp_path)
    assert "no file" in refusal(tmp_path / "gone.fmu", tmp_path)


def test_file_that_unpacks_to_too_much_is_refused(
    flywheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(description, "MAX_UNPACKED", 10_000_000)
    path = tmp_path / "large.fmu"
    shutil.copy(flywheel, path)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("resources/map", bytes(12_000_000))
    told = refusal(path, tmp_path)
    assert "large.fmu unpacks to 0.01" in told
    assert "at most 0.01 GB is unpacked" in told


def test_without_the_extra_the_error_names_it(
    flywheel: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "fmpy", None)
    assert "pip install 'rigd[fmu]'" in refusal(flywheel, tmp_path)
