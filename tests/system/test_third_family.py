"""A family of rigs that rigd does not know, installed from outside of the tree: a pendulum."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from support.commands.command import rigd

PENDULUM = Path(__file__).parents[1] / "pendulum"
#: What the rig file of the pendulum hides from the analysis.
TRUTH = {"coulomb": 0.01, "viscous": 0.002}


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the package installed, its rig file and its procedure."""
    wheels, folder = tmp_path_factory.mktemp("wheels"), tmp_path_factory.mktemp("lab")
    subprocess.run(
        [
            sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation",
            "--disable-pip-version-check", "--wheel-dir", str(wheels), str(PENDULUM),
        ],
        check=True,
    )  # fmt: skip
    (wheel,) = wheels.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(folder)  # commands look for packages where they start
    for name in ("rig.yaml", "swing.yaml"):
        (folder / name).write_text((PENDULUM / name).read_text())
    return folder


@pytest.fixture(scope="module")
def recording(lab: Path) -> Path:
    done = rigd("run", "swing.yaml", "--rig", "rig.yaml", "--output", "swing.mcap", cwd=lab)
    assert done.code == 0, done.err
    assert "rigd identify swing.mcap" in done.out
    return lab / "swing.mcap"


def test_a_third_family_is_listed_and_checked(lab: Path) -> None:
    assert "Coulomb and viscous friction of a pendulum" in rigd("analyses", cwd=lab).out
    checked = rigd("check", "rig.yaml", "swing.yaml", "--rig", "rig.yaml", cwd=lab)
    assert checked.code == 0, checked.err
    assert "3 trials on pendulum-1: right" in checked.out


def test_incomplete_plan_is_refused_at_its_line(lab: Path) -> None:
    text = (lab / "swing.yaml").read_text()
    (lab / "wrong.yaml").write_text(text.replace("    inertia: ${rig.inertia}\n", ""))
    refused = rigd("check", "wrong.yaml", "--rig", "rig.yaml", cwd=lab)
    line = 1 + text.splitlines().index("identify:")
    assert refused.code == 2
    assert f"wrong.yaml:{line}:" in refused.err
    assert "model pendulum needs the constant inertia" in refused.err


def test_third_family_friction_is_found_and_drawn(recording: Path) -> None:
    found = rigd("identify", "swing.mcap", "--json", cwd=recording.parent)
    assert found.code == 0, found.err
    for name, truth in TRUTH.items():
        item = found.json["parameters"][name]
        assert item["low"] < truth < item["high"], item
        assert item["identifiable"]
    page = recording.with_suffix(".html").read_text()
    assert "Friction of a pendulum" in page
    assert "torque of friction" in page


def test_third_family_model_is_refused_by_validate(recording: Path) -> None:
    found = rigd("identify", "swing.mcap", "--json", "--no-report", cwd=recording.parent)
    (recording.parent / "model.json").write_text(found.out)
    refused = rigd("validate", "model.json", "swing.mcap", cwd=recording.parent)
    assert refused.code == 2
    assert "models of pendulum cannot be validated" in refused.err


def test_third_family_recording_has_a_page(recording: Path) -> None:
    drawn = rigd("report", "swing.mcap", cwd=recording.parent)
    assert drawn.code == 0, drawn.err
    assert "encoder" in (recording.parent / "swing-run.html").read_text()


def test_option_that_it_does_not_take_is_refused(recording: Path) -> None:
    (recording.parent / "c.yaml").write_text("calibration: c\nrigs: [pendulum-1]\nvalues: {}\n")
    refused = rigd("identify", "swing.mcap", "--calibration", "c.yaml", cwd=recording.parent)
    assert refused.code == 2
    assert "--calibration: model pendulum" in refused.err
