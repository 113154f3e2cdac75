"""What no robot can be, or what the integrator cannot follow, is refused with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.model import ConfigError
from rigd.sdk.shipped_files import shipped_configs
from rigd_sim.articulated.plant import ArticulatedConfig

STIFF = "{stop: 100 deg, stiffness: 9e5 N m/rad, damping: 0.5 s/rad}"
SHIPPED = shipped_configs() / "plants" / "articulated.yaml"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("kinetic: 0.6 ", "kinetic: 0.95 ", "kinetic 0.95 exceeds static 0.9"),
        ("driven: all ", "driven: front ", "driven: front needs pairing: single"),
        ("driven: all ", "driven: rear ", "driven: rear needs pairing: single"),
        ("\n  rear:\n", "\n  rear:\n    drive: {gear_ratio: 30 N}\n", "is in N, expected 1"),
        ("\n  rear:\n", f"\n  rear:\n    hinge: {STIFF}\n", "lower modules.rear.hinge.stiffness"),
        ("longitudinal: 120 N s/m", "longitudinal: 300 N s/m", "settle at 6490 1/s, too fast"),
        ("stiffness: 11 kN/m", "stiffness: 20 MN/m", "swings on its suspension"),
        ("stiffness: 50 N m/rad", "stiffness: 9e5 N m/rad", "hinge stop swings"),
        ("radius: 40 mm", "radius: 40 kg", "is in kg, expected m"),
        ("  front:\n", "  front:\n    colour: red\n", "unknown key"),
    ],
)
def test_impossible_parameter_is_refused(old: str, new: str, words: str, tmp_path: Path) -> None:
    text = SHIPPED.read_text("utf-8")
    assert old in text
    file = tmp_path / "mine.yaml"
    file.write_text(text.replace(old, new), "utf-8")
    config = ArticulatedConfig.model_validate({"parameters": str(file)})
    with pytest.raises(ConfigError, match=words) as refused:
        config.read_parameters()
    assert "mine.yaml" in str(refused.value)


def test_wrong_coefficient_of_a_module_names_its_line(tmp_path: Path) -> None:
    text = SHIPPED.read_text("utf-8").replace(
        "rolling: 0.8 mm # paper, table 2\n", "rolling: 0.8 mm\n      kinetic: 0.95\n"
    )
    file = tmp_path / "mine.yaml"
    file.write_text(text, "utf-8")
    config = ArticulatedConfig.model_validate({"parameters": str(file)})
    with pytest.raises(ConfigError) as refused:
        config.read_parameters()
    line = 1 + text[: text.index("kinetic")].count("\n")
    assert f"mine.yaml:{line}:" in str(refused.value)
    assert "modules.front.contact.kinetic" in str(refused.value)
    assert "kinetic 0.95 of module front exceeds its static 0.9" in str(refused.value)


def test_robot_of_one_module_is_a_file(tmp_path: Path) -> None:
    """A module alone has the radius of articulated.md 3: R_kin times 1.195."""
    from support.articulated.robots import Driven, altered, radius, shipped

    front = shipped().modules["front"]
    load = {"modules": {"front": front}}
    robot = Driven(altered(load), poses=60_001).play(30.0, 200.0, 100.0, ramp_s=0.3)
    assert radius(robot.track[40_000:-1], 0) == pytest.approx(0.5316, abs=2e-3)
