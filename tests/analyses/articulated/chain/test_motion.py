"""The motion of a chain of modules is that of equations of another form, and of the plant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from support.articulated.chains import GEAR, Chain, Trial, drawn, played
from support.articulated.prescribed import Prescribed
from support.articulated.robots import altered, chain

from rigd_analyses.articulated.chain.kernel import VALUES, WORK, rates
from rigd_analyses.articulated.chain.layout import Layout, Motor
from rigd_analyses.articulated.chain.system import ChainSystem, contact_name
from rigd_analyses.articulated.reading import TORQUE_FRAMES, RobotTrial
from rigd_sim.articulated.parameters import ArticulatedParameters

Array = NDArray[np.float64]


def unlike(count: int, random: np.random.Generator) -> ArticulatedParameters:
    """Return a robot whose modules differ in all; which wheels drive is drawn."""
    modules = {
        name: altered(
            {
                "wheels.pairing": "single",
                "wheels.driven": str(random.choice(["all", "front", "rear", "none"])),
                "wheels.radius": random.uniform(0.03, 0.06),
                "half_track": random.uniform(0.1, 0.2),
                "contact.longitudinal": random.uniform(50.0, 200.0),
                "contact.lateral": random.uniform(50.0, 200.0),
                "contact.rolling": random.uniform(5e-4, 2e-3),
            },
            module,
        )
        for name, module in chain(count).modules.items()
    }
    found: ArticulatedParameters = altered({"modules": modules})
    return found


def values(robot: ArticulatedParameters) -> tuple[Array, Array]:
    """Return the values of the modules as the analysis takes them, and how many wheels drive."""
    rows = [
        [
            item.contact.longitudinal, item.contact.lateral,
            item.contact.rolling * robot.gravity * item.mass / 4.0 / item.wheels.radius,
            item.wheels.radius, item.half_track, item.half_wheelbase, item.hinge_ahead,
            item.hinge_behind, item.mass, item.inertia,
            item.wheels.spin_inertia / item.wheels.radius**2,
        ]
        for item in robot.modules.values()
    ]  # fmt: skip
    each = {"all": 2.0, "front": 1.0, "rear": 1.0, "none": 0.0}
    driven = [[each[item.wheels.driven]] * 2 for item in robot.modules.values()]
    return np.array(rows).reshape(-1, VALUES), np.array(driven)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 8])
def test_accelerations_are_those_by_multipliers(count: int) -> None:
    random = np.random.default_rng(count)
    for _ in range(20):
        robot = unlike(count, random)
        modules = list(robot.modules.values())
        headings = random.uniform(-3.0, 3.0) + random.uniform(-0.8, 0.8, count)
        turning, speed = random.standard_normal(count), random.standard_normal(2)
        spins = random.uniform(-10.0, 10.0, 4 * count)
        other = Prescribed(robot, spinning=random.standard_normal(4 * count))
        q, v = other.consistent(headings, speed, turning, spins)
        spin = np.zeros((count, 2))
        for j, module in enumerate(modules):
            for k in range(4):
                rho, _, phi = other.wheel(j, k)
                if other.driven(j, k):
                    spin[j, k & 1] += spins[4 * j + k]
                else:
                    v[phi] = v[rho] / module.wheels.radius
        expected, _ = other.solved(q, v, np.zeros(4 * count))
        of_modules, driven = values(robot)
        state = np.concatenate([np.zeros(2), headings, speed, turning, np.zeros(count)])
        found = np.zeros(count + 2)
        work, factor = np.zeros((count, WORK)), np.zeros((count + 2, count + 2))
        rates(of_modules, driven, spin, state, np.zeros(len(state)), work, factor, found)
        expected = np.concatenate([expected[:2], expected[2 : 3 * count : 3]])
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12 * np.max(np.abs(expected)))


def exact(robot: Chain, trial: Trial) -> tuple[ChainSystem, Array, Array]:
    """Return the system of one trial of the plant without noise, with its true parameters."""
    t_s, speeds, torques, poses = played(robot, trial, None)
    every = 20
    count, span = len(t_s[::every]), every * TORQUE_FRAMES
    total = np.cumsum(np.vstack([np.zeros((1, torques.shape[1])), torques]), axis=0)
    torques = np.vstack([np.zeros((span, torques.shape[1])), (total[span:] - total[:-span]) / span])
    names = tuple(f"{k + 1}" for k in range(len(robot.driven)))
    item = RobotTrial(
        "trial", "case", 1, every * (t_s[1] - t_s[0]), t_s[: (count - 1) * every + 1],
        every * np.arange(count), speeds[: (count - 1) * every + 1],
        torques[::every], poses[::every], np.ones((count, poses.shape[1]), np.bool_), 0.1, 1e-4,
        names,
    )  # fmt: skip
    sides = {"all": ("right", "left"), "front": ("front_right", "front_left"),
             "rear": ("rear_right", "rear_left"), "none": ()}  # fmt: skip
    motors = [Motor(k, side) for k, kind in enumerate(robot.driven) for side in sides[kind]]
    single = {f"module_{k}_body_mass": m for k, m in zip(names, robot.masses, strict=True)}
    single |= {f"module_{k}_hinge_distance": x for k, x in zip(names, robot.lengths, strict=True)}
    layout = Layout(len(names), tuple(motors), frozenset(single))
    constants = {name: (value, 0.01 * value) for name, value in {**robot.true, **single}.items()}
    truth = {name: (value, 0.01) for name, value in robot.truth.items()}
    system = ChainSystem((item,), constants, layout, np.full(len(motors), GEAR), truth)
    assert set(truth) == {contact_name(kind, k) for kind, k in layout.contacts}
    shared = np.array([unknown.parameter.start for unknown in system.shared])
    shared[system.names.index("latency")] = 0.0
    local = np.array([unknown.parameter.start for unknown in system.local])
    return system, shared, local


@pytest.mark.parametrize(
    "driven",
    [("all",), ("all", "all"), ("front", "none", "rear"), ("all", "none", "none", "all")],
)
def test_chain_moves_as_the_plant(driven: tuple[str, ...]) -> None:
    system, shared, local = exact(drawn(3, driven), Trial(150.0, 110.0, 5.0, 0.95))
    run = system.run(0, shared, local, np.zeros((len(system.raw(shared)), 0)))
    item = system.trials[0]
    apart = (run.pose - run.pose[0]) - (item.poses - item.standing)
    assert np.max(np.abs(apart)) < 3e-4
    found = system.simulate(0, shared, local)[:, : system.motors]
    late = slice(50, None)  # its own inertia is smoothed at the ramp
    np.testing.assert_allclose(found[late], item.torques[late], atol=1e-5)


@pytest.mark.parametrize("known", [False, True])
def test_derivatives_are_those_of_differences(known: bool) -> None:
    system, shared, local = exact(drawn(4, ("front", "none", "all")), Trial(120.0, 90.0, 3.0))
    if not known:
        system = replace(system, known={})
        shared[: len(system.contacts)] = [x.parameter.start * 1.1 for x in system.contacts]
    local[:] = [0.01, 0.02, 0.3, 0.02, -0.03, 2e-6]
    shared[system.names.index("latency")] = 0.013
    theta, count = np.concatenate([shared, local]), len(shared)
    _, slopes = system.linearise(0, shared, local)
    for k, value in enumerate(theta):
        step = np.zeros(len(theta))
        step[k] = 1e-6 * max(abs(value), 1e-3)
        ends = [
            system.simulate(0, (theta + way * step)[:count], (theta + way * step)[count:])
            for way in (1.0, -1.0)
        ]
        differences = (ends[0] - ends[1]) / (2.0 * step[k])
        scale = max(float(np.max(np.abs(differences))), 1e-9)
        assert np.max(np.abs(slopes[:, :, k] - differences)) < 1e-3 * scale
