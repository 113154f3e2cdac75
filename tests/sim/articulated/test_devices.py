"""Drives, markers and hidden state of the articulated robot, and how it is put to its start."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from rigd.sdk import DeviceError, ProtocolError
from rigd_sim.articulated.drive import ArticulatedDrive, DriveConfig
from rigd_sim.articulated.plant import ArticulatedConfig, ArticulatedPlant
from rigd_sim.articulated.sensors import (
    ArticulatedTracker,
    ArticulatedTruth,
    ModuleConfig,
    PoseRow,
    TruthConfig,
)

MS = 1_000_000


def made(seed: int = 1, **options: Any) -> ArticulatedPlant:
    config = ArticulatedConfig.model_validate(options)
    return ArticulatedPlant(config, period_ns=MS, seed=seed)


def drives(plant: ArticulatedPlant) -> list[ArticulatedDrive]:
    found = []
    for wheel in ("front_right", "front_left"):
        options = DriveConfig.model_validate({"module": "front", "wheel": wheel})
        found.append(ArticulatedDrive(options, plant))
        found[-1].open()
        found[-1].arm()
    return found


def marker(plant: ArticulatedPlant, module: str = "front") -> ArticulatedTracker:
    found = ArticulatedTracker(ModuleConfig(module=module), plant)
    found.open()
    return found


def truth(plant: ArticulatedPlant, module: str = "front") -> dict[str, float]:
    found = ArticulatedTruth(TruthConfig(module=module), plant)
    found.open()
    row = found.read(plant.now_ns)
    assert row is not None
    return dict(zip((channel.name for channel in found.declaration.channels), row, strict=True))


def played(plant: ArticulatedPlant, seconds: float, *markers: ArticulatedTracker) -> list[Any]:
    """Advance by cycles of 1 ms; return the rows of markers with the time at which they came."""
    rows = []
    for t_ns in range(plant.now_ns, plant.now_ns + round(seconds * 1e9), MS):
        plant.advance(t_ns)
        rows += [(t_ns, tracker.read(t_ns)) for tracker in markers]
    return [(t_ns, row) for t_ns, row in rows if row is not None]


def test_marker_shows_where_the_module_was() -> None:
    plant = made(noise=False)
    right, left = drives(plant)
    tracker = marker(plant)
    played(plant, 1.0)
    right.write((200.0,))
    left.write((120.0,))
    rows = played(plant, 2.0, tracker)
    assert [t_ns // MS for t_ns, _ in rows[1:]] == list(range(1020, 3000, 40))
    assert [row.frame for _, row in rows] == list(range(len(rows) + 24))[24:]
    again = made(noise=False)
    for motor, speed in zip(drives(again), (200.0, 120.0), strict=True):
        again.advance(999 * MS)
        motor.write((speed,))
    for _, row in rows[1:]:
        again.advance(round(row.frame) * 40 * MS)
        state = truth(again)
        assert (row.x, row.y) == pytest.approx((state["x"], state["y"]), abs=1e-9)
        assert row.heading == pytest.approx(math.remainder(state["heading"], 2 * math.pi), abs=1e-9)


def frames(plant: ArticulatedPlant, module: str, count: int) -> list[PoseRow | None]:
    """Return what the tracker makes of ``count`` frames of a robot at rest."""
    tracker = marker(plant, module)
    return [tracker.read(round((frame / 25 + 0.0201) * 1e9)) for frame in range(count)]


def test_camera_errs_as_its_parameters_state() -> None:
    rows = [frames(made(), module, 5000) for module in ("front", "rear")]
    lost = [sum(row is None for row in column) / 5000 for column in rows]
    assert lost == pytest.approx([0.01, 0.01], abs=5e-3)
    both = [(a, b) for a, b in zip(*rows, strict=True) if a is not None and b is not None]
    exchanged = [(a, b) for a, b in both if a.x < b.x]
    assert len(exchanged) / len(both) == pytest.approx(0.002, abs=2e-3)
    assert exchanged
    right = [(a, b) for a, b in both if a.x > b.x]
    x, y, heading = (np.array([getattr(b, key) for _, b in right]) for key in ("x", "y", "heading"))
    assert (np.std(x), np.std(y)) == pytest.approx((2e-3, 2e-3), rel=0.05)
    assert np.std(heading) == pytest.approx(math.radians(0.5), rel=0.05)


def test_camera_scale_stretches_its_axis() -> None:
    tracker = marker(made())
    rows = [tracker._camera.measured(0, frame, (0.3, 2.0, 0.1)) for frame in range(2000)]
    found = np.array([row for row in rows if row is not None])
    assert found[:, 0].mean() == pytest.approx(0.3, abs=2e-4)
    assert found[:, 1].mean() == pytest.approx(2.02, abs=2e-4)


def test_drive_reports_its_noisy_speed_and_torque() -> None:
    plant = made()
    right, left = drives(plant)
    for motor in (right, left):
        motor.write((250.0,))
    played(plant, 2.0)
    rows = np.array([right.read(plant.now_ns + k * MS) for k in range(1, 2000)])
    assert rows.mean(axis=0) == pytest.approx([250.0, 1.256e-3], abs=0.1)
    assert rows[:, 1].mean() == pytest.approx(1.256e-3, abs=1e-4)
    assert rows.std(axis=0) == pytest.approx([1.0, 1e-3], rel=0.1)


def test_drive_made_safe_gives_no_torque() -> None:
    plant = made(noise=False)
    right, left = drives(plant)
    for motor in (right, left):
        motor.write((250.0,))
    played(plant, 1.0)
    for motor in (right, left):
        motor.make_safe()
        motor.write((250.0,))
    played(plant, 1.0)
    assert right.read(plant.now_ns).torque == 0.0
    assert 0.0 < truth(plant)["forward_speed"] < 0.3  # it rolls on, slower and slower
    played(plant, 4.0)
    assert abs(truth(plant)["forward_speed"]) < 1e-3


def test_setpoint_that_is_nan_is_refused() -> None:
    right, _ = drives(made())
    with pytest.raises(DeviceError, match="NaN"):
        right.write((math.nan,))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"module": "middle", "wheel": "front_left"}, "no module 'middle'; it has front, rear"),
        (
            {"module": "rear", "wheel": "front_left"},
            "front left wheel of module 'rear' has no motor",
        ),
    ],
)
def test_drive_of_a_missing_motor_is_refused(options: dict[str, str], words: str) -> None:
    drive = ArticulatedDrive(DriveConfig.model_validate(options), made())
    with pytest.raises(ProtocolError, match=words):
        drive.open()


def test_robot_is_put_back_within_its_scatter() -> None:
    plant = made()
    right, left = drives(plant)
    for motor in (right, left):
        motor.write((250.0,))
    played(plant, 1.0)
    with pytest.raises(ValueError, match="stop the robot before you pick it up"):
        plant.change("robot", "start")
    for motor in (right, left):
        motor.write((0.0,))
    played(plant, 3.0)
    starts = []
    for _ in range(200):
        plant.change("robot", "start")
        state = truth(plant)
        starts.append((state["x"], state["y"], state["heading"]))
        assert state["forward_speed"] == 0.0
    assert np.std(starts, axis=0) == pytest.approx([5e-3, 5e-3, math.radians(1.0)], rel=0.2)
    energy = plant.energy()
    assert energy.dissipated > 0.1


def test_energy_balances_with_suspension_and_transfer() -> None:
    for loads in ("transfer", "vertical"):
        plant = made(loads=loads, noise=False)
        before = plant.energy()
        for motor, speed in zip(drives(plant), (400.0, 150.0), strict=True):
            motor.write((speed,))
        played(plant, 2.0)
        after = plant.energy()
        made_up = after.stored - before.stored - after.supplied + after.dissipated
        assert abs(made_up) < 2e-6 * after.supplied
        state = truth(plant)
        loaded = [state[f"{wheel}_load"] for wheel in ("front_right", "front_left")]
        assert loaded[0] > loaded[1] + 0.05  # a turn to the left loads the right wheels
