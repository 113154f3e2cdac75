"""Derived channels in the cycle: fresh in the cycle of their readings, and stale with them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from support.engine.bench import ListSink

from rigd.config.loader import parse_rig
from rigd.daemon.manual.choice import only
from rigd.engine.clock import VirtualClock
from rigd.engine.cycle.computing import late_after
from rigd.engine.cycle.wiring import wire
from rigd.engine.play.control import Control
from rigd.engine.process.in_process import InProcessHost
from rigd.engine.sink import Rows
from rigd.model.channels import STALE, STATUS_FIELD
from rigd.model.errors import LinkError
from rigd.model.rows import TIME_FIELD
from rigd.model.severity import Severity
from rigd.procedure.profiles.profiles import ConstantProfile
from rigd.procedure.program import Comparison, Condition, CycleProgram, Recorded, Segment
from rigd.sdk.shipped_files import shipped_folder

DERIVED = """\
derived:
  cart.twice: {is: 2 * carriage.position}
  cart.speed: {is: derivative(carriage.position)}
  cart.time: {is: "integral(where(carriage.position < 1 km, 1, 1))", reset: trial}
  drive.asked: {is: wheel_servo.current_setpoint}
  scaled.acceleration: {is: accelerometer.acceleration / 9.81 m/s^2, where: carriage.position > 0 m}
interlocks:
"""


class KeptRows(ListSink):
    """Keeps the rows of every stream."""

    def __init__(self) -> None:
        super().__init__()
        self.kept: dict[str, list[Rows]] = {}

    def write(self, stream: str, rows: Rows) -> None:
        self.kept.setdefault(stream, []).append(rows.copy())

    def of(self, stream: str) -> Rows:
        return np.concatenate(self.kept[stream])


class Played:
    """The rig of the first paper, simulated in process, with derived channels."""

    def __init__(self, interlocks: str = "") -> None:
        path = shipped_folder("configs") / "sim_lugre.yaml"
        text = path.read_text().replace("interlocks:\n", DERIVED + interlocks, 1)
        rig = parse_rig(text, path)
        clock = VirtualClock(rig.period_ns, 1_790_000_000_000_000_000)
        self.sink = KeptRows()
        cycle = wire(rig, clock, Control(), 1).cycle
        record = {stream.name: Recorded() for stream in cycle.rig.streams}
        self.host = InProcessHost(cycle, clock, virtual=True, sink=self.sink, record=record)
        assert not self.host.open()
        assert self.host.arm() is None

    def play(self, **segment: object) -> Severity:
        profiles = {
            "wheel_servo.current": ConstantProfile(0.6),
            "longitudinal_belt.engaged": ConstantProfile(0.0),
        }
        whole = {"duration_s": 0.3, **segment}
        outcome = self.host.play(CycleProgram((Segment("go", profiles, **whole),)))  # type: ignore[arg-type]
        self.host.drain()
        return outcome.severity


def test_derived_rows_belong_to_their_cycle() -> None:
    played = Played()
    played.play()
    carriage, cart = played.sink.of("carriage"), played.sink.of("cart")
    assert np.array_equal(cart["twice"], 2 * carriage["position"])
    assert np.allclose(cart["speed"][1:], np.diff(carriage["position"]) / 1e-3)
    assert not np.any(cart[STATUS_FIELD])
    wheel, drive = played.sink.of("wheel_servo"), played.sink.of("drive")
    # What was written in the cycle before: a setpoint follows the decision.
    assert np.array_equal(drive["asked"][1:], wheel["current_setpoint"][:-1])


def test_condition_ends_step_in_cycle_that_sees_it() -> None:
    played = Played()
    until = ((Condition("cart.twice", Comparison.ABOVE, 0.02),),)
    assert played.play(until=until, duration_s=None, timeout_s=5.0) is Severity.DONE
    twice = played.sink.of("cart")["twice"]
    assert twice[-1] > 0.02
    assert np.all(twice[:-1] <= 0.02)


def test_interlock_on_derived_channel_stops() -> None:
    played = Played(
        "  - {name: far, source: cart.twice, high: 10 mm, action: abort, message: Too far.}\n"
    )
    assert played.play(duration_s=2.0) is Severity.ABORT
    assert "cart.twice 0.01" in str(
        [data for _, kind, _, data in played.sink.events if kind == "interlock"]
    )


def test_reset_channel_begins_anew_with_each_trial() -> None:
    played = Played()
    played.host.trial = 1
    played.play(duration_s=0.1)
    played.host.trial = 2
    played.play(duration_s=0.05)
    time = played.sink.of("cart")["time"]
    assert time[-1] == pytest.approx(0.05, abs=2.1e-3)
    assert time.max() > 0.09


def test_value_is_unknown_while_where_does_not_hold() -> None:
    played = Played()
    played.play(duration_s=1.0)
    at, scaled = played.sink.of("carriage")["position"], played.sink.of("scaled")
    known = np.isfinite(scaled["acceleration"])
    assert np.array_equal(known, at > 0)
    assert 0 < known.sum() < len(known)


def test_row_is_stale_while_a_device_is_late() -> None:
    played = Played(
        "  - {name: lost, source: cart.twice, stale_after: 20 ms, action: abort, message: Lost.}\n"
    )
    carriage = next(m.driver for m in played.host.cycle.rig.mounts if m.name == "carriage")
    read, calls = carriage.read, []

    def late(t_ns: int) -> object:
        calls.append(t_ns)
        return read(t_ns) if len(calls) < 100 else None

    carriage.read = late  # type: ignore[method-assign, assignment]
    assert played.play(duration_s=1.0) is Severity.ABORT
    cart = played.sink.of("cart")
    stale = (cart[STATUS_FIELD] & STALE) != 0
    assert 19 <= stale.sum() <= 22
    assert np.all(np.diff(stale.astype(int)) >= 0)
    assert not math.isnan(cart["twice"][-1])
    assert not np.any(played.sink.of("scaled")[STATUS_FIELD][: -stale.sum()])
    trips = [str(data["reason"]) for _, kind, _, data in played.sink.events if kind == "interlock"]
    assert any("cart.twice is stale" in reason for reason in trips)


def test_failed_reading_repeats_no_computed_row() -> None:
    played = Played()
    carriage = next(m.driver for m in played.host.cycle.rig.mounts if m.name == "carriage")
    read, calls = carriage.read, []

    def broken(t_ns: int) -> object:
        calls.append(t_ns)
        if len(calls) == 100:
            raise LinkError("the cable is off")
        return read(t_ns)

    carriage.read = broken  # type: ignore[method-assign, assignment]
    assert played.play(duration_s=1.0) is Severity.FAULT
    times = played.sink.of("cart")[TIME_FIELD].astype(np.int64)
    assert np.all(np.diff(times) == 1_000_000)
    assert times[-1] == calls[-1] - 1_000_000


def test_derived_channel_is_late_with_its_readings() -> None:
    path = shipped_folder("configs") / "sim_lugre.yaml"
    rig = parse_rig(path.read_text().replace("interlocks:\n", DERIVED, 1), path)
    mounted = wire(rig, VirtualClock(rig.period_ns, 0), Control(), 1).cycle.rig
    for mount in mounted.mounts:
        if mount.name == "accelerometer":  # with a pace of its own
            declared = replace(mount.driver.declaration, every_cycle=False, silent_s=0.5)
            mount.driver.declaration = declared
    late_ns = late_after(mounted, rig.period_ns)
    for name, age_ns in (("scaled.acceleration", 500_000_000), ("cart.twice", 0)):
        assert late_ns[mounted.stamp_of[mounted.readings[name]]] == age_ns


def test_part_of_rig_computes_its_own_groups() -> None:
    derived = """\
derived:
  way.twice: {is: 2 * carriage.position + 1 m}
  push.twice: {is: 2 * accelerometer.acceleration}
interlocks:
"""
    path = shipped_folder("configs") / "sim_lugre.yaml"
    rig = parse_rig(path.read_text().replace("interlocks:\n", derived, 1), path)
    clock = VirtualClock(rig.period_ns, 1_790_000_000_000_000_000)
    cycle = wire(only(rig, ["push"]), clock, Control(), 1).cycle
    sink = KeptRows()
    record = {stream.name: Recorded() for stream in cycle.rig.streams}
    host = InProcessHost(cycle, clock, virtual=True, sink=sink, record=record)
    assert not host.open()
    assert host.arm() is None
    host.play(CycleProgram((Segment("rest", duration_s=0.01),)))
    host.drain()
    measured = sink.of("accelerometer")["acceleration"]
    assert np.array_equal(sink.of("push")["twice"], 2 * measured)
    assert cycle.readings()["push.twice"] == 2 * measured[-1]
