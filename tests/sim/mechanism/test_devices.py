"""Devices on a mechanism: channels and setpoints by name, and every promise of the SDK."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from support.mechanisms import MS

from rigd.config.loader import load_rig
from rigd.model.errors import ConfigError, DeviceError
from rigd.sdk.check import check_driver, check_plant
from rigd.sdk.check.plant.bench import Device
from rigd_sim.mechanism.device import MechanismDevice, MechanismDeviceConfig, MechanismTruth
from rigd_sim.mechanism.plant import MechanismConfig, MechanismPlant

RIG = """\
rig: bench
title: pin on disk
cycle: 1 kHz
plant: {model: mechanism}
devices:
  spindle:
    driver: sim-mechanism
    options: {channels: {angle: encoder, speed: tachometer}, setpoints: {speed: spindle}}
    limits: {speed: {low: 0 rad/s, high: 50 rad/s, rate: 100 rad/s^2}}
  cell:
    driver: sim-mechanism
    options: {channels: {force: {sensor: load_cell, scale: 10 N/V, zero: 0.1 V}}}
  truth: {driver: sim-mechanism-truth}
interlocks: []
"""
DEVICES: dict[str, Device] = {
    "spindle": (MechanismDevice, {"channels": {"angle": "encoder", "speed": "tachometer"},
                                  "setpoints": {"speed": "spindle"}}),
    "cell": (MechanismDevice, {"channels": {"force": "load_cell", "tip": "thermocouple"}}),
    "truth": (MechanismTruth, {}),
}  # fmt: skip


def rig_of(folder: Path, text: str) -> Any:
    path = folder / "rig.yaml"
    path.write_text(text, "utf-8")
    return load_rig(path)


def device(options: dict[str, Any], plant: MechanismPlant) -> MechanismDevice:
    config = MechanismDeviceConfig.model_validate(options, context={"plant": plant.config})
    return MechanismDevice(config, plant)


def test_shipped_mechanism_keeps_every_rule() -> None:
    report = check_plant(MechanismPlant, devices=DEVICES, truth="truth")
    assert report.skipped == {}


def test_rig_file_has_sensors_and_drives_as_channels(tmp_path: Path) -> None:
    rig = rig_of(tmp_path, RIG)
    (speed,) = rig.devices["spindle"].declaration.setpoints
    assert (speed.unit, speed.low, speed.high) == ("rad/s", -60.0, 60.0)
    for item in rig.devices.values():
        check_driver(item.driver_class, item.config)
    names = [item.name for item in rig.devices["cell"].declaration.channels]
    assert names == ["force", "force_raw"]


@pytest.mark.parametrize(
    ("old", "new", "place", "words"),
    [
        ("angle: encoder", "angle: encodr", "8:33", "no sensor 'encodr'; did you mean 'encoder'?"),
        ("{speed: spindle}}", "{speed: motor}}", "8:81", "no drive 'motor'; it has spindle"),
        ("scale: 10 N/V", "scale: 10 kg/V", "12:60", "not in N/V: give how many N each V means"),
        ("scale: 10 N/V", "scale: 0 N/V", "12:60", "scale is 0"),
        ("scale: 10 N/V, zero", "zero", "12:33", "needs its 'scale'"),
        ("{channels: {force: {sensor: load_cell, scale: 10 N/V, zero: 0.1 V}}}", "{}", "12:14",
         "name at least one sensor"),
        ("model: mechanism", "model: lugre", "7:13", "stands on a plant with 'model: mechanism'"),
        ("high: 50 rad/s", "high: 90 rad/s", "9:", "90 rad/s"),
    ],
)  # fmt: skip
def test_wrong_device_is_refused_with_its_place(
    tmp_path: Path, old: str, new: str, place: str, words: str
) -> None:
    assert old in RIG
    with pytest.raises(ConfigError) as caught:
        rig_of(tmp_path, RIG.replace(old, new))
    assert f"rig.yaml:{place}" in str(caught.value)
    assert words in str(caught.value)


def test_wrong_plant_file_is_reported_once(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("bodies: {a: {}}\n", "utf-8")
    with pytest.raises(ConfigError) as caught:
        rig_of(tmp_path, RIG.replace("{model: mechanism}",
                                     "{model: mechanism, parameters: mine.yaml}"))  # fmt: skip
    assert str(caught.value).count("\n  ") <= 1
    assert "mine.yaml:1:13: bodies.a: a has no mass" in str(caught.value)


def test_raw_value_follows_from_the_scale() -> None:
    plant = MechanismPlant(MechanismConfig(noise=False), period_ns=MS, seed=1)
    spindle = device(dict(DEVICES["spindle"][1]), plant)
    cell = device(
        {"channels": {"force": {"sensor": "load_cell", "scale": "-10 N/V", "zero": "0.1 V"}}},
        plant,
    )
    spindle.arm()
    spindle.read(0)
    spindle.write([20.0])
    force, volts = cell.read(500 * MS)
    assert force == pytest.approx(1.2949, abs=1e-3)
    assert (volts - 0.1) * -10 == pytest.approx(force)
    with pytest.raises(DeviceError, match="NaN"):
        spindle.write([math.nan])
    spindle.make_safe()
    spindle.read(5000 * MS)
    assert spindle.read(5001 * MS)[1] == pytest.approx(0.0, abs=1e-3)


def test_setpoint_beyond_the_drive_is_clipped() -> None:
    plant = MechanismPlant(MechanismConfig(noise=False), period_ns=MS, seed=1)
    spindle = device(dict(DEVICES["spindle"][1]), plant)
    spindle.arm()
    spindle.read(0)
    spindle.write([1e9])
    assert max(spindle.read(n * MS)[1] for n in range(1, 1000)) < 66.0


def test_operator_puts_another_weight_on() -> None:
    plant = MechanismPlant(MechanismConfig(noise=False), period_ns=MS, seed=1)
    assert set(plant.config.settings()) == {"contact_load"}
    spindle = device(dict(DEVICES["spindle"][1]), plant)
    spindle.arm()
    spindle.read(0)
    spindle.write([20.0])
    plant.change("contact_load", 2.0)
    cell = device({"channels": {"force": "load_cell"}}, plant)
    assert cell.read(500 * MS)[0] == pytest.approx(2 * 1.2949, abs=2e-3)
    with pytest.raises(ValueError, match="it takes 0 kg to 5 kg"):
        plant.change("contact_load", 6.0)


def test_checking_a_rig_loads_no_numba() -> None:
    code = (
        "import sys; from rigd_sim.mechanism.plant import MechanismConfig;"
        "MechanismConfig().mechanism(); assert 'numba' not in sys.modules, 'numba'"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
