"""The rig of ``examples/press``, made from its description: the load is held, friction is right."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from support.commands.command import rigd

from rigd.record import Recording

EXAMPLE = Path(__file__).parents[3] / "examples" / "press"


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    folder = tmp_path_factory.mktemp("press")
    done = rigd("new", "rig", "press", "--from", str(EXAMPLE / "press.yaml"), cwd=folder)
    assert done.code == 0, done.err
    rig = folder / "press"
    shutil.copy(EXAMPLE / "hold.yaml", rig / "procedures")
    run = ("run", "procedures/hold.yaml", "--rig", "sim.yaml", "--output", "hold.mcap")
    done = rigd(*run, cwd=rig)
    assert done.code == 0, done.err
    return Recording.open(rig / "hold.mcap")


def test_load_stays_within_one_percent(recording: Recording) -> None:
    load, lift = (recording.trial(1)[name] for name in ("load", "lift"))
    step, force = np.asarray(load["step"]), np.asarray(load["force"])
    for name, most in (("accelerate", 0.002), ("floors", 0.01)):
        off = force[step == name] / 20.0 - 1.0
        assert np.sqrt(np.mean(off**2)) < most, name
    # What the table moves would change the load by a quarter of it.
    moved_m = 0.0002 * np.ptp(np.asarray(lift["angle"])[step == "floors"])
    assert 20e3 * moved_m > 0.2 * 20.0


def test_friction_under_the_load_is_right(recording: Recording) -> None:
    """0.12, and viscous 0.008333 s/m at 40 rad/s on 30 mm."""
    contact = recording.trial(1)["contact"]
    end = (np.asarray(contact["step"]) == "floors").nonzero()[0][-200:]
    assert np.mean(np.asarray(contact["mu"])[end]) == pytest.approx(0.12 + 0.0083 * 1.2, rel=0.01)
