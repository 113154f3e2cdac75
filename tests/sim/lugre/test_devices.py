"""The devices on the plant: channels, conversion, arming, safe states, refused setpoints."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import entry_points

import pytest
from pydantic import ValidationError

from rigd.sdk import DeviceError, Driver
from rigd_sim.lugre import layout
from rigd_sim.lugre.amplifier import AmplifierConfig, LugreAmplifier
from rigd_sim.lugre.belt import BeltConfig, LugreBelt
from rigd_sim.lugre.plant import LugrePlant
from rigd_sim.lugre.sensors import (
    AccelerometerConfig,
    EncoderConfig,
    LugreAccelerometer,
    LugreEncoder,
    LugreTruth,
)

MakePlant = Callable[..., LugrePlant]
MS = 1_000_000


def run(plant: LugrePlant, until_ms: int) -> None:
    plant.advance(until_ms * MS)


def every_device(plant: LugrePlant) -> list[Driver]:
    return [
        LugreAmplifier(AmplifierConfig(), plant),
        LugreBelt(BeltConfig(axis="longitudinal"), plant),
        LugreBelt(BeltConfig(axis="lateral"), plant),
        LugreEncoder(EncoderConfig(axis="wheel"), plant),
        LugreEncoder(EncoderConfig(axis="carriage"), plant),
        LugreAccelerometer(AccelerometerConfig(), plant),
        LugreTruth(LugreTruth.Config(), plant),
    ]


def test_every_entry_point_resolves_without_loading_the_physics() -> None:
    """Checking a rig file asks every driver for its declaration and must stay fast."""
    script = (
        "import sys\n"
        "from importlib.metadata import entry_points\n"
        "for group in ('rigd.drivers', 'rigd.plants'):\n"
        "    for point in entry_points(group=group):\n"
        "        if 'lugre' in point.name: point.load()\n"
        "from rigd_sim.lugre.belt import BeltConfig, LugreBelt\n"
        "LugreBelt.declare(BeltConfig(axis='lateral'))\n"
        "heavy = {'numba', 'numpy', 'scipy'} & set(sys.modules)\n"
        "sys.exit(f'loaded {heavy}' if heavy else 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    names = {point.name for point in entry_points(group="rigd.drivers")}
    assert {"sim-lugre-amplifier", "sim-lugre-belt", "sim-lugre-encoder"} <= names


def test_every_row_has_a_value_per_channel(make_plant: MakePlant) -> None:
    plant = make_plant()
    for device in every_device(plant):
        device.open()
        device.arm()
        row = device.read(MS)
        assert row is not None
        declared = device.declaration
        assert len(row) == len(declared.channels) + declared.has_status
        assert all(math.isfinite(value) for value in row)
        if declared.has_status:
            assert isinstance(row[-1], int)
        device.make_safe()
        device.make_safe()
        device.close()


def test_unopened_devices_are_made_safe_silently(make_plant: MakePlant) -> None:
    for device in every_device(make_plant()):
        device.make_safe()


def test_the_amplifier_drives_only_once_armed(make_plant: MakePlant) -> None:
    plant = make_plant(noise=False)
    amplifier = LugreAmplifier(AmplifierConfig(), plant)
    plant.advance(0)
    amplifier.write((1.0,))
    run(plant, 5)
    assert amplifier.read(5 * MS)[0] == 0.0
    amplifier.arm()
    amplifier.write((1.0,))
    run(plant, 10)
    current, volts, status = amplifier.read(10 * MS)
    assert current == pytest.approx(1.0, abs=1e-6)
    assert volts == pytest.approx(-0.4, abs=1e-6), "the monitor is inverted"
    assert status == layout.AMPLIFIER_ENABLED
    amplifier.make_safe()
    run(plant, 15)
    assert amplifier.read(15 * MS)[0] == pytest.approx(0.0, abs=1e-6)
    assert amplifier.read(15 * MS)[-1] == 0


def test_amplifier_reports_its_limit(make_plant: MakePlant) -> None:
    plant = make_plant(noise=False)
    amplifier = LugreAmplifier(AmplifierConfig(current_range="3 A"), plant)  # type: ignore[arg-type] # as in a rig file
    belt = LugreBelt(BeltConfig(axis="longitudinal"), plant)
    plant.advance(0)
    amplifier.arm()
    belt.arm()
    amplifier.write((3.0,))
    belt.write((0.0, 0.0))
    run(plant, 5)
    current, *_, status = amplifier.read(5 * MS)
    assert current == pytest.approx(2.0, abs=1e-6)
    assert int(status) & layout.AMPLIFIER_CURRENT_LIMITED
    assert not int(status) & layout.AMPLIFIER_VOLTAGE_SATURATED
    run(plant, 900)
    assert int(amplifier.read(900 * MS)[-1]) & layout.AMPLIFIER_VOLTAGE_SATURATED


def test_setpoint_that_is_no_number_never_reaches_physics(make_plant: MakePlant) -> None:
    plant = make_plant()
    amplifier = LugreAmplifier(AmplifierConfig(), plant)
    belt = LugreBelt(BeltConfig(axis="lateral"), plant)
    for device in (amplifier, belt):
        device.arm()
    before = plant.commands.copy()
    with pytest.raises(DeviceError, match="'current' is NaN; expected -2 to 2 A"):
        amplifier.write((math.nan,))
    for setpoints in ((math.nan, 1.0), (0.3, math.nan)):
        with pytest.raises(DeviceError, match="is NaN"):
            belt.write(setpoints)
    assert (plant.commands == before).all()


def test_setpoints_beyond_the_range_are_clipped(make_plant: MakePlant) -> None:
    plant = make_plant()
    amplifier = LugreAmplifier(AmplifierConfig(), plant)
    belt = LugreBelt(BeltConfig(axis="lateral"), plant)
    for device in (amplifier, belt):
        device.arm()
    amplifier.write((math.inf,))
    belt.write((-9.0, 5.0))
    assert plant.commands[layout.WHEEL_CURRENT] == 2.0
    assert plant.commands[layout.LATERAL_COMMANDS] == -0.8
    assert plant.commands[layout.LATERAL_COMMANDS + 1] == 1.0


def test_belt_made_safe_brakes_and_ignores_setpoints(make_plant: MakePlant) -> None:
    plant = make_plant()
    belt = LugreBelt(BeltConfig(axis="longitudinal"), plant)
    plant.advance(0)
    belt.arm()
    belt.write((0.5, 1.0))
    run(plant, 400)
    _, speed, _, status = belt.read(400 * MS)
    assert speed == pytest.approx(0.5, abs=0.01)
    assert status == layout.BELT_ENABLED | layout.BELT_CLUTCHED
    belt.make_safe()
    belt.write((0.5, 0.0))
    run(plant, 900)
    _, speed, _, status = belt.read(900 * MS)
    assert speed == pytest.approx(0.0, abs=3e-3)
    assert status == layout.BELT_CLUTCHED


def test_conversions_follow_the_calibration(make_plant: MakePlant) -> None:
    """A corrected scale changes the converted value, never the raw one."""
    plant = make_plant(noise=False, vibration=False)
    plant.advance(0)
    plant.commands[layout.BELT_COMMANDS] = 0.5
    run(plant, 500)
    wheel = LugreEncoder(EncoderConfig(axis="wheel"), plant)
    angle, counts = wheel.read(500 * MS)
    assert angle == pytest.approx(counts * 2 * math.pi / (1024 * 20.25))
    position, counts = LugreEncoder(EncoderConfig(axis="carriage"), plant).read(500 * MS)
    truth = LugreTruth(LugreTruth.Config(), plant).read(500 * MS)
    assert position == pytest.approx(truth[0], rel=1e-10)
    corrected = EncoderConfig.model_validate(
        {"axis": "carriage", "distance_per_count": "30 um/count"}
    )
    assert LugreEncoder(corrected, plant).read(500 * MS) == pytest.approx((counts * 30e-6, counts))
    upright = AmplifierConfig.model_validate({"monitor_inverted": False, "monitor_zero": "1 V"})
    current, volts, *_ = LugreAmplifier(upright, plant).read(500 * MS)
    assert current == pytest.approx((volts - 1.0) * 2.5)
    acceleration, volts = LugreAccelerometer(AccelerometerConfig(), plant).read(500 * MS)
    assert acceleration == pytest.approx(volts / 0.102)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"axis": "wheel", "distance_per_count": "31 um/count"}, "belongs to 'axis: carriage'"),
        ({"axis": "carriage", "gear_ratio": 20}, "belongs to 'axis: wheel'"),
        ({"axis": "carriage", "distance_per_count": "31 um"}, "expected m/count"),
        ({"axis": "diagonal"}, "'wheel' or 'carriage'"),
    ],
)
def test_wrong_encoder_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        EncoderConfig.model_validate(options)
