"""The lateral sweep end to end on the simulated rig; the truth is the plant's parameters."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from support.commands.command import rigd

SHIPPED = Path(__file__).parents[2] / "procedures/lateral_sweep.yaml"
SPEEDS = "lateral_speed: [0.2 m/s, 0.35 m/s, 0.5 m/s, 0.65 m/s]"
CURRENTS = "current: {from: 0.6 A, to: 1.5 A, step: 0.3 A}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a sweep of three speeds, two currents and both directions."""
    folder = tmp_path_factory.mktemp("lateral")
    text = SHIPPED.read_text()
    assert SPEEDS in text and CURRENTS in text
    text = text.replace(SPEEDS, "lateral_speed: [0.2 m/s, 0.5 m/s, 0.65 m/s]")
    (folder / "lateral.yaml").write_text(text.replace(CURRENTS, "current: [0.6 A, 1.2 A]"))
    done = rigd(
        "run", "lateral.yaml", "--rig", "lugre-1", "--seed", "4", "--output", "lateral.mcap",
        cwd=folder,
    )  # fmt: skip
    assert done.code == 0, done.err
    return folder


@pytest.fixture(scope="module")
def found(folder: Path) -> Any:
    done = rigd("identify", "lateral.mcap", "--json", "--no-report", cwd=folder)
    assert done.code == 0, done.err
    return json.loads(done.out)


def test_plant_is_recovered(found: Any) -> None:
    for name, truth in (("mu_R_dry", 0.035), ("mu_R_vis", 0.03)):
        entry = found["parameters"][name]
        assert entry["identifiable"], entry
        assert entry["low"] <= truth <= entry["high"], entry
    assert "as printed" in found["coupling"]


def test_speed_is_explained_by_the_coupling(found: Any) -> None:
    together = found["speed_error"]["together"]
    assert {name: item["trials"] for name, item in together.items()} == {
        "positive": 6, "negative": 6, "all": 12,
    }  # fmt: skip
    for item in together.values():
        assert item["ratio"] > 10.0
    assert together["positive"]["final_error_ignored_m_s"] > 0.0
    assert together["negative"]["final_error_ignored_m_s"] < 0.0


def test_lever_on_the_other_side_gives_exit_8(folder: Path) -> None:
    done = rigd(
        "identify", "lateral.mcap", "--no-report", "--set", "guide_lever=-12 mm", cwd=folder
    )
    assert done.code == 8
    assert "sign would have to be turned" in " ".join(done.out.split())
