"""The approach-angle rig at the wire, part by part: world, relay, sampling, scale."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from rigd_sim.approach_angle import layout
from rigd_sim.approach_angle.plant import AngleConfig, AnglePlant
from rigd_sim.approach_angle.wire import Sampled, WireAngle, WireAngleConfig
from rigd_sim.approach_angle.wire_relay import SimRelay
from rigd_sim.approach_angle.world import AngleWorld
from rigd_sim.wire.folder import Folder
from rigd_sim.wire.instruments.scale import SimScale

MS = 1_000_000
ONE_SHOT_S = 0.18


class Clock:
    """Time that passes on command."""

    def __init__(self) -> None:
        self.ns = 1_000_000_000_000

    def __call__(self) -> int:
        return self.ns

    def pass_ms(self, ms: float) -> None:
        self.ns += round(ms * MS)


@pytest.fixture
def clock() -> Clock:
    return Clock()


def plant(**options: Any) -> AnglePlant:
    given = {"voltage": "10 V", **options}
    return AnglePlant(AngleConfig.model_validate(given), period_ns=MS, seed=1)


def world(clock: Clock, one_shot_s: float | None = ONE_SHOT_S, **options: Any) -> AngleWorld:
    return AngleWorld(plant(**options), one_shot_s, clock)


def test_relay_needs_its_line_and_one_shot(clock: Clock) -> None:
    found = world(clock)
    found.ask(closed=True)
    clock.pass_ms(50)
    assert found.state()["platform_position"] == pytest.approx(0, abs=1e-6)
    assert found.safe_since_ns
    found.trigger(level=True)
    clock.pass_ms(100)
    assert float(found.state()["platform_speed"]) > 0.05
    assert not found.safe_since_ns
    found.ask(closed=False)
    assert found.safe_since_ns == clock.ns


def test_one_shot_drops_when_due_without_any_reader(clock: Clock) -> None:
    found = world(clock)
    found.ask(closed=True)
    found.trigger(level=True)
    edge_ns = clock.ns
    clock.pass_ms(150)
    found.trigger(level=False)  # either edge keeps it up
    clock.pass_ms(400)  # no client has read
    found.now()
    assert found.safe_since_ns == edge_ns + 150 * MS + ONE_SHOT_S * 1e9
    assert found.opened.at_ns == found.safe_since_ns
    assert 0 < found.opened.position < found.furthest
    assert not found.one_shot_up()


def test_state_at_relay_opening_is_kept(clock: Clock) -> None:
    found = world(clock, one_shot_s=None, noise=False)
    found.ask(closed=True)
    while float(found.state()["platform_position"]) < 0.1:
        clock.pass_ms(5)
    found.ask(closed=False)
    state = found.state()
    opened = found.opened
    assert opened.position == state["platform_position"]
    assert opened.speed == state["platform_speed"]
    pots = found.plant.parameters.potentiometers
    thread = (opened.position + pots.platform_start) / pots.pulley
    assert opened.volts == pytest.approx(thread * pots.volts_per_rad, rel=1e-9)
    clock.pass_ms(2000)
    found.now()
    assert found.furthest > 0.45  # the relay does not stop it, the bumper does


def test_set_up_of_unknown_friction_is_not_driven(clock: Clock) -> None:
    found = world(clock, one_shot_s=None)
    found.change("wheel", "coated")
    found.change("angle", math.radians(30))
    found.ask(closed=True)
    assert "no friction is published for the coated wheel at 30 deg" in found.refused
    clock.pass_ms(500)
    assert not found.plant.closed
    found.change("wheel", "clean")
    clock.pass_ms(100)
    found.now()
    assert found.refused == ""
    clock.pass_ms(20)
    found.now()
    assert found.plant.closed


def test_welded_and_broken_contact_are_simulated(clock: Clock) -> None:
    found = world(clock)
    relay = SimRelay("relay", found, "a line")
    relay.inject("welded")
    clock.pass_ms(100)
    state = relay.state()
    assert (state["coil"], state["contact"]) == (False, True)
    relay.clear("welded")
    clock.pass_ms(100)
    assert not relay.state()["contact"]
    relay.inject("broken")
    found.trigger(level=True)
    found.ask(closed=True)
    clock.pass_ms(100)
    state = relay.state()
    assert (state["coil"], state["contact"]) == (True, False)
    relay.clear()
    clock.pass_ms(20)
    assert relay.state()["contact"]


def test_one_shot_that_stays_up_keeps_relay(clock: Clock) -> None:
    found = world(clock)
    relay = SimRelay("relay", found, "a line")
    relay.inject("one_shot_dead")
    found.ask(closed=True)
    clock.pass_ms(1000)
    assert relay.state()["coil"]
    relay.clear("one_shot_dead")
    assert not relay.state()["coil"]


def test_faults_of_relay_that_it_does_not_know(clock: Clock) -> None:
    relay = SimRelay("relay", world(clock, one_shot_s=None), "a line")
    for fault, options in (("fire", {}), ("welded", {"side": "left"})):
        with pytest.raises(ValueError, match="it knows welded: "):
            relay.inject(fault, **options)
    with pytest.raises(ValueError, match="stands behind no one-shot"):
        relay.inject("one_shot_dead")


def test_card_samples_plant_at_its_own_rate(clock: Clock) -> None:
    item = world(clock, noise=False)
    inputs: list[int | None] = [3, None, 0]  # platform, nothing, gauge a: as the task has them
    sampler = Sampled(item, inputs, 9600.0, clock.ns)
    found = []
    for _ in range(500):
        clock.pass_ms(2)
        found.append(sampler.due(clock.ns, 40e-6))
    volts = np.hstack(found)
    assert volts.shape[0] == 3
    assert 9600 - 16 <= volts.shape[1] <= 9600
    pots = item.plant.parameters.potentiometers
    at_start = pots.platform_start / pots.pulley * pots.volts_per_rad
    assert volts[0] == pytest.approx(at_start, abs=1e-6)


def test_samples_not_fetched_for_long_are_lost(clock: Clock) -> None:
    found = world(clock)
    sampler = Sampled(found, [0], 9600.0, clock.ns)
    clock.pass_ms(1e3 * (layout.HISTORY_ROWS / layout.STEPS_PER_S + 1))
    with pytest.raises(OverflowError, match="are lost"):
        sampler.due(clock.ns, 0.0)


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Folder]:
    with Folder(tmp_path) as found:
        yield found


def config(**options: Any) -> WireAngleConfig:
    return WireAngleConfig.model_validate({"folder": "/tmp/none", **options})


def test_the_parts_are_those_of_the_rig(folder: Folder) -> None:
    _, parts = WireAngle(config()).build(folder)
    assert [part.name for part in parts] == ["daq", "relay", "scale"]
    state = parts[0].state()
    assert state["ai3_v"] == pytest.approx(0.4775, abs=0.02)
    assert state["ai2_v"] == pytest.approx(0.46, abs=0.1)


def test_scale_is_plants_and_stable_when_that_is(folder: Folder) -> None:
    simulation = WireAngle(config(plant={"noise": False, "load": "5 kg"}))
    found, parts = simulation.build(folder)
    assert isinstance(found, AngleWorld)
    scale = parts[2]
    assert isinstance(scale, SimScale)
    assert not scale.weighing.stable  # it has just been switched on
    start_ns = found.plant.now_ns
    found.plant.advance(start_ns + 5_000 * MS)
    for t_s in (1.0, 1.1, 1.2):
        scale.weighing.advance(t_s, found.plant.scale()[0])
    assert scale.weighing.stable
    assert scale.weighing.gross_kg == pytest.approx(5.0, abs=0.01)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"daq": {"gauge_b": "ai0"}}, "two sensors are wired to the same input"),
        ({"relay": {"active": "up"}}, "'high' or 'low'"),
        ({"relay": {"one_shot": {"time": "2 s"}}}, "less than or equal to 1"),
    ],
)
def test_impossible_benches_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        config(**options)
