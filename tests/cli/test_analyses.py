"""``rigd analyses``: everything installed is listed, in any state."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

import pytest
from support.commands.command import rigd


@pytest.fixture
def with_broken(tmp_path: Path) -> Path:
    """A folder in which a package is installed whose analyses cannot be loaded."""
    info = tmp_path / "acme-2.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 2.1\n")
    (info / "entry_points.txt").write_text(
        "[rigd.analyses]\nacme-missing = acme_missing:Analysis\nacme-plain = acme_plain:Thing\n"
    )
    (tmp_path / "acme_plain.py").write_text("class Thing: pass\n")
    return tmp_path


def test_every_installed_analysis_is_listed(tmp_path: Path) -> None:
    listed = rigd("analyses", cwd=tmp_path)
    assert listed.code == 0, listed.err
    names = [point.name for point in entry_points(group="rigd.analyses")]
    assert names
    for name in names:
        assert any(line.startswith(f"{name} ") for line in listed.out.splitlines())
    assert "broken" not in listed.out


def test_analysis_is_shown_with_its_needs(tmp_path: Path) -> None:
    shown = rigd("analyses", "approach-angle", cwd=tmp_path)
    assert shown.code == 0, shown.err
    for text in (
        "normal_force (V)",
        "angle (rad)",
        "pre_trigger (s)",
        "set, load, voltage",
        "torque_scale",
        "--calibration",
    ):
        assert text in shown.out
    (found,) = rigd("analyses", "lugre", "--json", cwd=tmp_path).json
    assert found["signals"]["acceleration"] == "m/s^2"
    assert found["constant_units"]["torque_constant"] == "N m/A"
    assert "by_recording" in found["options"]
    assert "{value: 50 mm, u: 0.1 mm}" in rigd("analyses", "lugre", cwd=tmp_path).out


def test_broken_analysis_does_not_hide_others(with_broken: Path) -> None:
    listed = rigd("analyses", cwd=with_broken)
    assert listed.code == 0, listed.err
    assert "broken: ModuleNotFoundError: No module named 'acme_missing'" in listed.out
    assert "is not derived from Analysis of rigd.analysis" in listed.out
    assert "lugre" in listed.out
    assert rigd("analyses", "acme-plain", cwd=with_broken).code == 2


def test_unknown_analysis_is_refused_with_nearest_name(tmp_path: Path) -> None:
    absent = rigd("analyses", "lugres", cwd=tmp_path)
    assert absent.code == 2
    assert "there is no analysis 'lugres'" in absent.err
    assert "did you mean 'lugre'?" in absent.err


def test_a_broken_analysis_stops_no_other_rig(with_broken: Path) -> None:
    """A rig with a calibration asks every analysis for its values."""
    checked = rigd("check", "angle-1", cwd=with_broken)
    assert checked.code == 0, checked.err
