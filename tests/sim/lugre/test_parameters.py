"""The parameter file: what is shipped is the paper's rig, and what is wrong is refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from rigd.model.errors import ConfigError
from rigd_sim.lugre.parameters import LugreParameters
from rigd_sim.lugre.plant import LugreConfig

SHIPPED = LugreConfig.find_parameters("lugre")


def edited(folder: Path, old: str, new: str) -> Path:
    text = SHIPPED.read_text("utf-8")
    assert text.count(old) == 1, f"{old!r} must stand once in the shipped file"
    file = folder / "edited.yaml"
    file.write_text(text.replace(old, new), "utf-8")
    return file


def test_the_shipped_file_is_the_paper_s_rig(parameters: LugreParameters) -> None:
    guide, mass = parameters.carriage.guide, parameters.carriage.mass
    arm = guide.contact_arm - guide.mass_arm
    friction = guide.dry * mass * parameters.gravity * arm / guide.half_span
    assert friction == pytest.approx(0.304, abs=1e-6)
    assert mass == 3.9593
    assert parameters.drive.gear_ratio == 20.25
    assert parameters.floors.pvc.stribeck_speed == 0.0044
    assert parameters.sensors.guide_resolution == pytest.approx(3.0679616e-5)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass_offset: -12 mm", "mass_offset: 12 mm", r"must lie between the rows, within \(-0.04"),
        ("viscous: 0.03 s/m", "viscous: 0.06 s/m", "loop gain 2 s c / j = 1.04"),
        ("resistance: 3.2 ohm", "resistance: 22 ohm", "leaves 0.545 A at half of the no-load"),
        ("resistance: 3.2 ohm", "resistance: 3.2 V", "expected ohm"),
        ("resistance: 3.2 ohm", "resistance: 3.2", "has no unit: write '3.2 ohm'"),
        ("resistance: 3.2 ohm", "resistence: 3.2 ohm", "resistence"),
        ("mu_static: 0.15", "mu_static: 0.11", "mu_static 0.11 is below mu_coulomb 0.12"),
        ("mass: 3.9593 kg", "mass: -1 kg", "greater than or equal to 0.5"),
        ("stiffness: 20 kN/m", "stiffness: 1000 MN/m", "less than or equal to 1000000"),
        ("low: -50 mm", "low: 50 mm", "on either side of the start"),
        ("efficiency: 0.81", "efficiency: 1.2", "less than or equal to 1"),
    ],
)
def test_wrong_parameter_is_refused_with_its_place(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    file = edited(tmp_path, old, new)
    with pytest.raises(ConfigError, match=message) as raised:
        LugreConfig(parameters=str(file)).read_parameters()
    assert str(raised.value).startswith(f"{file}:")


def test_parameter_error_names_place_of_value(tmp_path: Path) -> None:
    file = edited(tmp_path, "resistance: 3.2 ohm", "resistance: 3.2 V")
    lines = file.read_text("utf-8").splitlines()
    line = next(n for n, text in enumerate(lines, 1) if "resistance: 3.2 V" in text)
    with pytest.raises(ConfigError, match=rf"edited\.yaml:{line}:15: drive\.resistance: '3\.2 V'"):
        LugreConfig(parameters=str(file)).read_parameters()


def test_every_problem_is_named(tmp_path: Path) -> None:
    file = edited(tmp_path, "resistance: 3.2 ohm", "resistance: 3.2 V")
    file.write_text(file.read_text("utf-8").replace("supply: 24 V", "supply: 24 A"), "utf-8")
    with pytest.raises(ConfigError) as raised:
        LugreConfig(parameters=str(file)).read_parameters()
    assert len(raised.value.others) == 1


@pytest.mark.parametrize("content", [b"\xff\xfe", b"gravity: [1", b"", b"- 1", b"a: 1\na: 2"])
def test_file_without_parameters_is_refused(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "broken.yaml"
    file.write_bytes(content)
    with pytest.raises(ConfigError, match=r"broken\.yaml"):
        LugreConfig(parameters=str(file)).read_parameters()


def test_a_file_beside_the_rig_file_comes_first(tmp_path: Path) -> None:
    mine = tmp_path / "lugre.yaml"
    mine.write_text("", "utf-8")
    assert LugreConfig.find_parameters("lugre.yaml", tmp_path) == mine
    assert LugreConfig.find_parameters("plants/lugre.yaml", tmp_path) == SHIPPED
    config = LugreConfig.model_validate({"parameters": "lugre.yaml"}, context={"folder": tmp_path})
    assert config.parameters == str(mine)


def test_file_in_current_folder_is_not_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "plants").mkdir()
    for name in ("lugre", "lugre.yaml", "plants/lugre.yaml"):
        (tmp_path / name).write_text("", "utf-8")
    monkeypatch.chdir(tmp_path)
    for name in ("lugre", "lugre.yaml", "plants/lugre.yaml"):
        assert LugreConfig(parameters=name).parameters == str(SHIPPED)
    assert list(LugreConfig().files()) == [SHIPPED]
    beside = {"folder": tmp_path}  # of the rig file: it names none
    assert LugreConfig.model_validate({}, context=beside).parameters == str(SHIPPED)


def test_missing_parameter_file_is_refused_by_check() -> None:
    with pytest.raises(ValidationError, match="no parameter file 'luger'"):
        LugreConfig(parameters="luger")
