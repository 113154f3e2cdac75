"""The simulator of what can be wrong: correct if nothing is, and every kind of it shows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.cases import some
from support.lugre.kinds import KINDS
from support.lugre.sensors import Sensor
from support.lugre.wrong import GUIDE, World, control, right

from rigd_analyses.lugre.trials.trial import LugreTrial

SHORT = (((1.5, 0.9),), ((0.75, 0.25), (-0.9, 0.35)))
SIGNALS = (
    *("wheel_angle_rad", "carriage_position_m", "acceleration_m_s2", "motor_current_a"),
    "held",
)


def bare(world: World) -> World:
    """Return ``world`` with perfect sensors and no vibration."""
    perfect = Sensor()
    return replace(
        world, wheel=perfect, guide=perfect, accelerometer=perfect, current=perfect, shake=0.0,
        physics=world.physics._replace(ripple=0.0),
    )  # fmt: skip


def test_correct_world_agrees_with_the_bench(bench: Callable[..., Any]) -> None:
    other = bench("pvc", noisy=False, max_s=1.5).trial(0.9, 1)
    world = replace(bare(right("pvc")), program=(((0.9, 1.15),),))
    (trial,) = world.trials(1)
    turned = trial.wheel_angle_rad - trial.wheel_angle_rad[0]
    count = int(np.argmax(other.carriage_position_m > 1.14))
    for mine, its in (
        (0.05 * turned, 0.05 * other.wheel_angle_rad),
        (trial.carriage_position_m, other.carriage_position_m),
        (trial.motor_current_a, other.motor_current_a),
    ):
        np.testing.assert_allclose(mine[:count], its[:count], atol=2e-6)


def test_kinds_are_many_and_differ() -> None:
    fields = {(kind.field, kind.sizes, kind.also, kind.same) for kind in KINDS}
    assert len({kind.name for kind in KINDS}) == len(KINDS) == len(fields) >= 120


@pytest.mark.parametrize("kind", some(KINDS, 3), ids=lambda kind: kind.name)
def test_each_size_of_wrong_world_changes_data(kind: Any) -> None:
    base = right("pvc")
    if kind.field.startswith("stated."):
        stated = [kind.world(base, size).rig for size in kind.sizes]
        assert len({base.rig, *stated}) == 4
        return
    sound = replace(base, program=SHORT).trials(1)
    found = [replace(kind.world(base, size), program=SHORT).trials(1) for size in kind.sizes]
    moved = [_difference(sound, trials) for trials in found]
    assert min(moved) > 0.0, "something is recorded that was not"
    assert all(
        np.all(np.isfinite(getattr(t, name))) for ts in found for t in ts for name in SIGNALS
    )


def test_a_control_states_constants_within_their_uncertainty() -> None:
    worlds = [control(number) for number in range(6)]
    assert len({world.physics for world in worlds}) == 6
    for world in worlds:
        off = abs(world.rig.wheel_radius.value - world.physics.radius)
        assert 0.0 < off < 4.0 * world.rig.wheel_radius.u


def test_eccentric_measuring_wheel_swings_once_a_turn() -> None:
    world = replace(bare(right("pvc")), program=(((0.9, 1.1),),))
    true = world.trials(1)[0].carriage_position_m
    shown = replace(world, guide_eccentric=1e-4).trials(1)[0].carriage_position_m
    turns = np.array([np.ones_like(true), np.cos(true / 0.02), np.sin(true / 0.02)]).T
    size = np.linalg.lstsq(turns, shown - true, rcond=None)[0]
    assert np.hypot(size[1], size[2]) == pytest.approx(1e-4, rel=0.01)


def test_late_sensor_shows_past_values() -> None:
    world = replace(bare(right("pvc")), program=SHORT)
    late = replace(world, guide=Sensor(delay_s=2e-3))
    now, then = (w.trials(1)[0].carriage_position_m for w in (world, late))
    np.testing.assert_allclose(then[2:], now[:-2], atol=1e-9)


def test_recorded_positions_are_whole_counts() -> None:
    position = replace(right("pvc"), program=SHORT).trials(1)[0].carriage_position_m
    counts = position / GUIDE.count
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)


def _difference(some: list[LugreTrial], others: list[LugreTrial]) -> float:
    """Return by how much two recordings differ, 1 if they differ in length."""
    worst = 0.0
    for first, second in zip(some, others, strict=True):
        if len(first.t_s) != len(second.t_s):
            return 1.0
        worst = max(
            worst, *(float(np.max(np.abs(getattr(first, n) - getattr(second, n)))) for n in SIGNALS)
        )
    return worst
