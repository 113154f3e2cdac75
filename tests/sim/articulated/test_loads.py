"""Load transfer and vertical dynamics: options that are off for the numbers of the paper."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.articulated.robots import Driven, altered, radius

from rigd_sim.articulated import layout

Array = NDArray[np.float64]
NAMES = [name for name, _, _ in layout.TRUTH]
HALF = 2.5e-4  # the step that the plant takes with these options, in s


def loads(robot: Driven, module: int) -> Array:
    """Return the normal forces of a module's wheels in N, in the order of layout.WHEELS."""
    shown = dict(zip(NAMES, robot.truth(module), strict=True))
    return np.array([shown[f"{wheel}_load"] for wheel in layout.WHEELS])


def steady(mode: str) -> Driven:
    robot = Driven(loads=mode, step_s=HALF, poses=80_001)
    return robot.play(20.0, 200.0, 100.0, ramp_s=0.3)


@pytest.fixture(scope="module")
def transfer() -> Driven:
    return steady("transfer")


@pytest.fixture(scope="module")
def vertical() -> Driven:
    return steady("vertical")


def test_transfer_and_vertical_agree_on_a_circle(transfer: Driven, vertical: Driven) -> None:
    """At a steady speed they differ by the moment of rolling resistance alone."""
    for module in (0, 1):
        assert loads(transfer, module) == pytest.approx(loads(vertical, module), abs=0.2)
        assert loads(vertical, module).sum() == pytest.approx(39.24, abs=1e-6)
    radii = [radius(robot.track[-50_000:-1], 0) for robot in (transfer, vertical)]
    assert radii[0] == pytest.approx(radii[1], abs=5e-4)


def test_lateral_force_loads_the_outer_wheels(transfer: Driven) -> None:
    """Right less left is h F_y / b of each module; the hinge pulls the rear one outwards."""
    found = []
    for module in (0, 1):
        shown = dict(zip(NAMES, transfer.truth(module), strict=True))
        across = sum(shown[f"{wheel}_f_lat"] for wheel in layout.WHEELS)
        right, left = loads(transfer, module)[[0, 2]].sum(), loads(transfer, module)[[1, 3]].sum()
        assert right - left == pytest.approx(0.06 * across / 0.148333, rel=1e-4)
        found.append(right - left)
    assert found[0] > 1.0
    assert found[1] < -1.0


def test_equal_modules_carry_their_weight_equally() -> None:
    equal = Driven(loads="equal", step_s=HALF, poses=20_001).play(5.0, 200.0, 100.0, ramp_s=0.3)
    module = Driven(loads="module", step_s=HALF, poses=20_001).play(5.0, 200.0, 100.0, ramp_s=0.3)
    assert np.abs(equal.track - module.track).max() < 1e-12
    heavier = altered({"modules.rear.body_mass": 5.6})
    unlike = Driven(heavier, loads="module").play(0.1, 0.0, 0.0)
    assert [loads(unlike, place)[0] for place in (0, 1)] == pytest.approx([9.81, 14.715])


@pytest.mark.parametrize("mode", ["transfer", "vertical"])
def test_acceleration_loads_the_rear_axle(mode: str) -> None:
    """By h F / d; on the suspension also by rolling resistance and what turns the wheels up."""
    robot = Driven(loads=mode, step_s=HALF)
    robot.play(0.5, 100.0, 100.0, ramp_s=0.5)
    shown = dict(zip(NAMES, robot.truth(0), strict=True))
    moment = 0.06 * sum(shown[f"{wheel}_f_lon"] for wheel in layout.WHEELS)
    if mode == "vertical":
        moment += 8e-4 * 39.24 + 2 * (2 * 8e-5 + 25**2 * 1e-6) * (100.0 / 25.0) / 0.5
    front, rear = loads(robot, 0)[:2].sum(), loads(robot, 0)[2:].sum()
    assert rear - front == pytest.approx(moment / 0.0507, rel=0.02)
    assert front + rear == pytest.approx(39.24, abs=0.1)


@pytest.mark.parametrize(("mode", "lowest"), [("transfer", 3.0), ("vertical", 1e-9)])
def test_energy_balances_while_wheels_lift_off(mode: str, lowest: float) -> None:
    robot, least = Driven(loads=mode, step_s=HALF), 9.81
    for _ in range(100):
        robot.play(0.005, 500.0, 500.0)
        least = min(least, loads(robot, 0).min())
    assert least < lowest
    assert abs(robot.residual) < 1e-4


def test_module_stands_still_on_its_suspension() -> None:
    robot = Driven(loads="vertical", step_s=HALF).play(1.0, 0.0, 0.0)
    assert np.abs(robot.state).max() == pytest.approx(0.2, abs=1e-12)  # the centre of mass
    assert loads(robot, 0) == pytest.approx(9.81, abs=1e-9)


def test_heave_decays_as_its_spring_and_damper() -> None:
    robot = Driven(loads="vertical", step_s=HALF)
    heave = robot.robot.size - 12
    robot.state[heave] = 1e-4
    rate, damping = np.sqrt(4 * 11_000 / 4.0), 4 * 60.0 / (2 * 4.0)
    turned = np.sqrt(rate**2 - damping**2)
    robot.play(0.1, 0.0, 0.0)
    expected = (
        1e-4
        * np.exp(-damping * 0.1)
        * (np.cos(turned * 0.1) + damping / turned * np.sin(turned * 0.1))
    )
    assert robot.state[heave] == pytest.approx(expected, abs=1e-9)
