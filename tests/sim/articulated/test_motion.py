"""The articulated robot against the reference numbers of articulated.md, sections 1, 5 and 6."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import root
from support.articulated.multipliers import Multipliers
from support.articulated.robots import Driven, altered, chain, radius, shipped, unlike

from rigd_sim.articulated import layout
from rigd_sim.articulated.parameters import ArticulatedParameters

Array = NDArray[np.float64]
TEN_SECONDS = 20_000
MIRROR = np.array([1.0, -1.0])
SINGLE = {
    "modules.*.wheels.pairing": "single",
    "modules.front.wheels.driven": "front",
}


@pytest.fixture(scope="module")
def circle() -> Driven:
    """The paper's circle: 200 and 100 rad/s for a minute, ramped in 0.3 s."""
    return Driven(poses=120_001).play(60.0, 200.0, 100.0, ramp_s=0.3)


def test_circle_has_the_radii_of_the_paper(circle: Driven) -> None:
    steady = circle.track[TEN_SECONDS:-1]
    assert radius(steady, 0) == pytest.approx(0.46601, abs=2e-5)
    assert radius(steady, 1) == pytest.approx(0.46450, abs=2e-5)


def test_circle_ends_in_the_reference_pose(circle: Driven) -> None:
    assert circle.centres[0] == pytest.approx([-0.397434, 0.617267], abs=1e-6)
    assert circle.headings == pytest.approx([29.57855, 28.7306], abs=5e-5)
    assert circle.yaw_rates == pytest.approx(0.495675, abs=1e-6)
    hinge = math.degrees(circle.headings[0] - circle.headings[1])
    assert hinge == pytest.approx(48.585, abs=2e-3)
    assert circle.torques() == pytest.approx([6.587e-3, 1.615e-3], abs=1e-6)


def test_circle_has_the_reference_contact_forces(circle: Driven) -> None:
    front = dict(zip((name for name, _, _ in layout.TRUTH), circle.truth(0), strict=True))
    rear = dict(zip((name for name, _, _ in layout.TRUTH), circle.truth(1), strict=True))
    assert front["front_right_f_lon"] == pytest.approx(1.862, abs=1e-3)
    assert front["rear_left_f_lon"] == pytest.approx(0.308, abs=1e-3)
    assert rear["front_left_f_lon"] == pytest.approx(-0.196, abs=1e-3)
    assert (front["front_right_f_lat"], front["rear_right_f_lat"]) == pytest.approx(
        (-4.214, 5.839), abs=1e-3
    )
    assert (rear["front_left_f_lat"], rear["rear_left_f_lat"]) == pytest.approx(
        (-6.186, 3.866), abs=1e-3
    )
    assert {value for name, value in front.items() if name.endswith("sliding")} == {0.0}


def test_energy_of_circle_balances_over_a_minute(circle: Driven) -> None:
    supplied = circle.state[circle.robot.first_spin + 3 * circle.m]
    assert supplied == pytest.approx(87.54, abs=0.01)
    assert abs(circle.residual) < 1e-9 * supplied


@pytest.mark.parametrize(("ramp_s", "travel"), [(0.5, 1.08794), (0.0, 1.17021)])
def test_straight_run_has_the_reference_travel(ramp_s: float, travel: float) -> None:
    robot = Driven().play(3.0, 250.0, 250.0, ramp_s=ramp_s)
    assert robot.centres[0, 0] == pytest.approx(travel, abs=1e-5 if ramp_s else 1e-4)
    assert abs(robot.residual) < 1e-4
    assert robot.truth(0)[3] == pytest.approx(0.39836, abs=1e-5)
    assert robot.torques() == pytest.approx(1.256e-3, abs=1e-6)


@pytest.mark.parametrize(
    ("target", "sliding_s"), [(100.0, 0.0), (150.0, 0.045), (250.0, 0.109), (500.0, 0.259)]
)
def test_step_starts_slide_as_long_as_documented(target: float, sliding_s: float) -> None:
    robot, slid = Driven(), 0
    for _ in range(800):
        robot.play(5e-4, target, target)
        slid += bool(robot.slides.any())
    assert slid * 5e-4 == pytest.approx(sliding_s, abs=2e-3)


def steady_circle(right: float, left: float) -> tuple[float, float]:
    """Return both radii in m of the steady motion, found by the multipliers' form alone."""
    other, drive = Multipliers(shipped(), "linear"), shipped().drive
    radius_m = shipped().modules["front"].wheels.radius
    driven = np.array([right, left, right, left]) / drive.gear_ratio

    def motion(unknown: Array) -> tuple[Array, Array]:
        forward, aside, rate, hinge, *rear = unknown
        spins = np.concatenate([driven, rear, rear])
        return other.consistent(
            np.array([0.0, -hinge]), np.array([forward, aside]), np.full(2, rate), spins
        )

    def unsteady(unknown: Array) -> Array:
        q, v = motion(unknown[:6])
        pair = unknown[6:8]
        found, _ = other.solved(q, v, np.concatenate([pair, pair, np.zeros(4)]))
        turning = unknown[2] * np.array([-unknown[1], unknown[0]])
        return np.concatenate([found[:2] - turning, [found[2], found[5]], found[[22, 23, 26, 27]]])

    mean = radius_m * driven.mean()
    guess = np.array([mean, 0.0, 0.5, 0.8, mean / radius_m, mean / radius_m, 0.1, 0.02])
    found = root(unsteady, guess, tol=1e-13)
    assert found.success
    _, v = motion(found.x[:6])
    return math.hypot(v[0], v[1]) / v[2], math.hypot(v[3], v[4]) / v[2]


def test_circle_agrees_with_the_steady_state(circle: Driven) -> None:
    found = steady_circle(200.0, 100.0)
    steady = circle.track[3 * TEN_SECONDS : -1]
    assert [radius(steady, 0), radius(steady, 1)] == pytest.approx(found, abs=1e-6)


@pytest.mark.parametrize(
    ("right", "left", "law", "expected"),
    [
        (50.0, 25.0, "paper", 0.4875),
        (100.0, 50.0, "paper", 0.4732),
        (400.0, 200.0, "linear", 0.4623),
    ],
)
def test_radius_depends_on_speed_as_documented(
    right: float, left: float, law: str, expected: float
) -> None:
    robot = Driven(law=law, poses=60_001).play(30.0, right, left, ramp_s=0.3)
    assert radius(robot.track[2 * TEN_SECONDS : -1], 0) == pytest.approx(expected, abs=3e-4)


def test_single_wheels_driven_in_front_widen_circle() -> None:
    robot = Driven(altered(SINGLE), poses=60_001).play(30.0, 200.0, 100.0, ramp_s=0.3)
    assert radius(robot.track[2 * TEN_SECONDS : -1], 0) == pytest.approx(0.4816, abs=1e-4)


@pytest.mark.parametrize("law", ["paper", "smooth"])
def test_exchanged_motors_give_the_mirrored_motion(law: str) -> None:
    one_way = Driven(law=law).play(5.0, 500.0, 250.0)
    other_way = Driven(law=law).play(5.0, 250.0, 500.0)
    assert one_way.centres * MIRROR == pytest.approx(other_way.centres, abs=1e-12)
    assert one_way.headings == pytest.approx(-other_way.headings, abs=1e-12)


def test_located_events_keep_the_order_four() -> None:
    """Runge-Kutta alone would be of first order across the jumps of the paper's law."""
    strong = altered({"drive.torque_limit": 1.0})  # a limited torque has kinks of its own

    def end(parts: int) -> Array:
        return Driven(strong, step_s=5e-4 / parts).play(0.9, 250.0, 250.0).centres.ravel()

    best = end(16)
    first, second = (np.abs(end(parts) - best).max() for parts in (1, 2))
    assert 1e-8 < first < 1e-6
    assert second < first / 8


def test_smooth_law_differs_from_paper_near_jump_alone() -> None:
    ramped, smooth = (
        Driven(law=law).play(3.0, 250.0, 250.0, ramp_s=0.5) for law in ("paper", "smooth")
    )
    assert np.array_equal(ramped.state, smooth.state)
    stepped = [Driven(law=law).play(3.0, 250.0, 250.0).centres[0, 0] for law in ("paper", "smooth")]
    assert 1e-6 < abs(stepped[0] - stepped[1]) < 2e-4


def test_hinge_stop_holds_a_folding_robot() -> None:
    robot = Driven().play(3.0, -300.0, -280.0)
    hinge = robot.headings[0] - robot.headings[1]
    assert math.radians(100.0) < abs(hinge) < math.radians(115.0)
    assert abs(robot.residual) < 1e-4
    without = Driven(altered({"hinge.stiffness": 0.0})).play(3.0, -300.0, -280.0)
    assert abs(without.headings[0] - without.headings[1]) > math.radians(120.0)


def test_chain_of_five_modules_keeps_its_energy() -> None:
    robot = Driven(chain(5)).play(10.0, 200.0, 150.0, ramp_s=0.3)
    assert abs(robot.residual) < 1e-7
    assert robot.centres.shape == (5, 2)
    apart = robot.centres[:-1] - robot.centres[1:]
    assert (np.hypot(*apart.T) < 0.6).all()


@pytest.mark.parametrize("robot", [chain(3), unlike()], ids=["first drives", "unlike"])
def test_chain_mirrors_exchanged_motors(robot: ArticulatedParameters) -> None:
    pairs = len(Driven(robot).driven) // 2
    one_way = Driven(robot).play(5.0, *[450.0, 200.0] * pairs)
    other_way = Driven(robot).play(5.0, *[200.0, 450.0] * pairs)
    assert one_way.centres * MIRROR == pytest.approx(other_way.centres, abs=1e-12)
    assert one_way.headings == pytest.approx(-other_way.headings, abs=1e-12)
    assert abs(one_way.headings[-1]) > 0.5
    assert abs(one_way.residual) < 1e-4


def test_coasting_chain_loses_what_contacts_take() -> None:
    robot = Driven(unlike(), "linear").play(1.0, 400.0, 200.0, 400.0, 200.0, ramp_s=0.3)
    robot.commands[:, 1] = 0.0
    stored = [robot.robot.stored(robot.state)]
    for _ in range(20):
        robot._advance(50)
        stored.append(robot.robot.stored(robot.state))
    assert np.all(np.diff(stored) < 0.0)
    assert abs(robot.residual) < 1e-6 * stored[0]


@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_free_chain_keeps_energy_and_momentum(count: int) -> None:
    contact = {f"modules.*.contact.{name}": 1e-9 for name in ("longitudinal", "lateral", "rolling")}
    robot = Driven(chain(count, **contact, **{"hinge.stop": 3.14}), "linear")
    moving = robot.n + 2
    robot.state[moving : moving + 2] = 0.3, -0.1
    robot.state[moving + 2 : moving + 2 + robot.n] = np.linspace(1.0, -0.5, robot.n)
    before = robot.robot.stored(robot.state)
    robot.commands[:, 1] = 0.0
    robot._advance(4000)
    assert robot.robot.stored(robot.state) == pytest.approx(before, rel=1e-7)
    assert robot.state[moving : moving + 2] == pytest.approx([0.3, -0.1], rel=1e-6)


def test_module_of_little_grip_slides_first() -> None:
    """The last module's own mu_s holds for its wheels alone."""
    robot = chain(3, **{"modules.m2.contact.static": 0.3, "modules.m2.contact.kinetic": 0.2})
    slides = Driven(robot).play(10.0, 200.0, 100.0, ramp_s=0.3).slides.reshape(3, 4)
    assert slides[2, :2].all()
    assert not slides[:2].any()


def test_hinge_with_its_own_stop_bends_less() -> None:
    stop = altered({"stop": 0.2}, shipped().hinge)
    robot = Driven(chain(3, **{"modules.m2.hinge": stop})).play(10.0, 200.0, 100.0, ramp_s=0.3)
    first, second = -np.diff(robot.headings)
    assert 0.2 < second < 0.3
    assert first > 0.5
