"""The closed form of the plant against 30 coordinates with 18 constraints and multipliers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from support.articulated.multipliers import Multipliers
from support.articulated.robots import Driven, altered, chain, shipped, unlike

Array = NDArray[np.float64]
SINGLE = {"modules.*.wheels.pairing": "single"}
FREE_STOP = {"hinge.stop": 3.14}
ROBOTS: dict[str, Any] = {
    "geared": altered(FREE_STOP),
    "single": altered(FREE_STOP | SINGLE | {"modules.front.wheels.driven": "front"}),
    "all driven": altered(FREE_STOP | SINGLE | {"modules.*.wheels.driven": "all"}),
    "one module": chain(1, **FREE_STOP),
    "five modules": chain(5, **FREE_STOP),
    "eight modules": chain(8, **FREE_STOP),
    "unlike modules": unlike(),
}


def random_state(robot: Driven, random: np.random.Generator) -> tuple[Array, Array, Array]:
    """Put ``robot`` into a random state; return headings, rates and velocity of the first."""
    n, m, state = robot.n, robot.m, robot.state
    headings = np.cumsum(random.uniform(-1.5, 1.5, n))
    rates, first = random.normal(0.0, 2.0, n), random.normal(0.0, 0.5, 2)
    state[:] = robot.robot.placed(0.0, 0.0, headings)
    state[n + 4 : 2 * n + 4] = rates
    turning = np.stack([-rates * np.sin(headings), rates * np.cos(headings)], axis=1)
    state[n + 2 : n + 4] = first - robot.robot.beta[0] @ turning
    state[robot.robot.first_spin : robot.robot.first_spin + m] = random.normal(0.0, 12.0, m)
    robot.commands[robot.driven, 1] = 1.0
    robot.commands[robot.driven, 0] = random.normal(0.0, 200.0, len(robot.driven))
    return headings, rates, first


def wheel_torques(robot: Driven) -> Array:
    """Return the torque in N m on each wheel; a geared pair shares that of its motor."""
    on_spin = np.zeros(robot.m)
    on_spin[robot.driven] = robot.torques() * robot.robot.spins["ratio"][robot.driven]
    wheels = robot.robot.wheel_spin.ravel()
    shared: Array = on_spin[wheels] / np.bincount(wheels)[wheels]
    return shared


def accelerations(robot: Driven) -> Array:
    """Return x'', y'', theta'' of every module, then the wheels' phi'', by the closed form."""
    n, rates = robot.n, robot.rates()
    turning, headings, omega = rates[n + 4 : 2 * n + 4], robot.headings, robot.yaw_rates
    bent = np.stack(
        [
            -turning * np.sin(headings) - omega**2 * np.cos(headings),
            turning * np.cos(headings) - omega**2 * np.sin(headings),
        ],
        axis=1,
    )
    centres = rates[n + 2 : n + 4] + robot.robot.beta @ bent
    first = robot.robot.first_spin
    spins = rates[first : first + robot.m][robot.robot.wheel_spin.ravel()]
    return np.concatenate([np.column_stack([centres, turning]).ravel(), spins])


@pytest.mark.parametrize("law", ["paper", "smooth", "linear"])
@pytest.mark.parametrize("name", ROBOTS)
def test_closed_form_agrees_with_multipliers(name: str, law: str) -> None:
    parameters, random = ROBOTS[name], np.random.default_rng(1)
    robot, other = Driven(parameters, law), Multipliers(parameters, law)
    worst = 0.0
    for _ in range(200 if name == "geared" else 50):
        headings, rates, first = random_state(robot, random)
        at = robot.robot.first_spin
        spins = robot.state[at : at + robot.m][robot.robot.wheel_spin.ravel()]
        q, v = other.consistent(headings, first, rates, spins)
        found, _ = other.solved(q, v, wheel_torques(robot))
        theirs = np.concatenate([found[: 3 * robot.n], found[11 * robot.n :]])
        worst = max(
            worst, float(np.max(np.abs(accelerations(robot) - theirs)) / np.abs(theirs).max())
        )
    assert worst < 1e-12


def test_constraints_of_the_paper_have_full_rank() -> None:
    other = Multipliers(altered(SINGLE))
    q, v = other.consistent(np.array([0.3, -0.4]), np.array([0.2, 0.1]), np.ones(2), np.ones(8))
    a, rates = other.constraints(q, v)
    assert a.shape == (18, 30)
    assert np.linalg.matrix_rank(a) == 18
    assert np.abs(a @ v).max() < 1e-14
    # A' q' is the derivative of A q' along the motion.
    ahead, _ = other.constraints(q + 1e-6 * v, v)
    behind, _ = other.constraints(q - 1e-6 * v, v)
    assert (ahead - behind) @ v / 2e-6 == pytest.approx(rates, abs=1e-8)


def test_both_forms_move_alike() -> None:
    """A start of 0.25 s to 80 and 20 rad/s, in which no torque is limited; the other by DOP853."""
    targets = np.array([80.0, 20.0])
    robot = Driven().play(0.25, *targets)
    rate, start = Multipliers(shipped()).start(targets)
    end = solve_ivp(rate, (0.0, 0.25), start, method="DOP853", rtol=1e-9, atol=1e-12).y[:6, -1]
    ours = np.column_stack([robot.centres, robot.headings]).ravel()
    assert ours == pytest.approx(end, abs=1e-7)
    assert ours[2] > 0.01


def test_contact_forces_as_printed_create_energy() -> None:
    """Eq. 18 as printed has the forces on the wrong side (articulated.md 1.2)."""
    other = Multipliers(shipped())
    q, v = other.consistent(np.zeros(2), np.array([0.4, 0.0]), np.zeros(2), np.zeros(8))
    found, _ = other.solved(q, v, np.zeros(8))
    mass = other.mass()
    assert v @ (mass * found) < 0.0
    a, rates = other.constraints(q, v)
    whole = np.block([[np.diag(mass), a.T], [a, np.zeros((len(a), len(a)))]])
    printed = np.linalg.solve(whole, np.concatenate([-other.forces(v, np.zeros(8)), -rates]))
    assert v @ (mass * printed[:30]) > 0.0
