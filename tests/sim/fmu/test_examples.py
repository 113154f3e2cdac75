"""The units made from our own plants give what the plants themselves give."""

from __future__ import annotations

import runpy
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from rigd_sim.articulated.plant import ArticulatedConfig, ArticulatedPlant
from rigd_sim.fmu.device import FmuDevice, FmuDeviceConfig
from rigd_sim.fmu.plant import FmuConfig, FmuPlant
from rigd_sim.lugre import layout
from rigd_sim.lugre.plant import LugreConfig, LugrePlant

EXAMPLES = Path(__file__).parents[3] / "examples" / "fmu"
MS = 1_000_000


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with both FMUs, which FMPy has found valid."""
    folder = tmp_path_factory.mktemp("made")
    arguments = sys.argv
    sys.argv = ["build_fmus", str(folder)]
    try:
        with pytest.raises(SystemExit) as end:
            runpy.run_path(str(EXAMPLES / "build_fmus"))
    finally:
        sys.argv = arguments
    assert end.value.code == 0
    return folder


def test_missing_package_is_named_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pythonfmu3.builder", None)
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(EXAMPLES / "build_fmus"))
    assert "pip install 'rigd[fmu]' pythonfmu pythonfmu3" in str(end.value.code)


def device_on(fmu: Path, options: Mapping[str, Any], **start: str) -> FmuDevice:
    config = FmuConfig.model_validate({"file": str(fmu), "start": start})
    plant = FmuPlant(config, period_ns=MS, seed=1)
    return FmuDevice(FmuDeviceConfig.model_validate(options, context={"plant": config}), plant)


def test_lugre_unit_of_fmi_2_is_the_plant(made: Path) -> None:
    names = {"current": "A", "enabled": "1"}
    device = device_on(
        made / "LugreRig.fmu",
        {
            "inputs": {
                **{name: {"variable": name, "unit": unit} for name, unit in names.items()},
                "engaged": {"variable": "belt_engaged", "unit": "1", "safe": "1"},
            },
            "outputs": {name: {"variable": name, "unit": unit} for name, unit, _ in layout.TRUTH},
        },
        floor="pvc",
        mass="4.2",
    )
    options = {"floor": "pvc", "mass": "4.2 kg", "noise": False}
    plant = LugrePlant(LugreConfig.model_validate(options), period_ns=MS, seed=1)
    for cycle in range(300):
        row = list(device.read(cycle * MS))
        assert row == plant.readings_at(cycle * MS)[layout.TRUTH_READINGS :]
        current = 0.003 * cycle
        device.write([current, 1.0, 0.0])
        plant.commands[layout.WHEEL_CURRENT] = current
        plant.commands[layout.WHEEL_ENABLED] = 1.0
        plant.commands[layout.BELT_COMMANDS + 1] = 0.0
    names_of_truth: list[str] = [name for name, _, _ in layout.TRUTH]
    assert row[names_of_truth.index("carriage_speed")] > 0.1
    device.close()


def test_robot_unit_of_fmi_3_is_the_plant(made: Path) -> None:
    device = device_on(
        made / "ArticulatedRobot.fmu",
        {
            "inputs": {
                "right": {"variable": "right_speed", "unit": "rad/s"},
                "left": {"variable": "left_speed", "unit": "rad/s"},
                "enabled": {"variable": "enabled", "unit": "1"},
            },
            "outputs": {"x": "x", "heading": "heading", "forward": "forward_speed"},
        },
    )
    config = ArticulatedConfig.model_validate({"law": "smooth", "noise": False})
    plant = ArticulatedPlant(config, period_ns=MS, seed=1)
    spins = [plant.spin_of("front", wheel) for wheel in ("front_right", "rear_left")]
    for cycle in range(0, 300, 10):
        row = device.read(cycle * MS)
        plant.advance(cycle * MS)
        truth = plant.truth(0)
        # The speed goes by way of rpm: rounding alone.
        assert list(row) == pytest.approx([truth[0], truth[2], truth[3]], rel=1e-12, abs=1e-18)
        device.write([20.0, 10.0, 1.0])
        plant.commands[spins[0]] = 20.0, 1.0
        plant.commands[spins[1]] = 10.0, 1.0
    assert row[1] > 0
    device.close()
