"""Observers in the cycle: used by conditions and interlocks, NaN once a sensor is lost."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.engine.bench import ListSink

from rigd.config.loader import parse_rig
from rigd.engine.clock import VirtualClock
from rigd.engine.cycle.wiring import wire
from rigd.engine.play.control import Control
from rigd.engine.process.in_process import InProcessHost
from rigd.engine.sink import Rows
from rigd.model.channels import STALE, STATUS_FIELD
from rigd.model.severity import Severity
from rigd.procedure.profiles.profiles import ConstantProfile
from rigd.procedure.program import Comparison, Condition, CycleProgram, Recorded, Segment
from rigd.sdk.shipped_files import shipped_folder

OBSERVERS = """\
observers:
  cart:
    model: linear
    states: {position: m, speed: m/s, bias: m/s^2}
    inputs: [accelerometer.acceleration]
    measured: [carriage.position]
    a: [[0, 1, 0], [0, 0, -1], [0, 0, 0]]
    b: [[0], [1], [0]]
    c: [[1, 0, 0]]
    q: [0, 1e-4 m^2/s^3, 1e-6]
    r: [1e-10]
    x0: [0, 0, 0]
    p0: [1e-4, 1e-2, 1e-2]
    lost_after: 15 ms
    reset: trial
derived:
  cart_mean.nis: {is: "mean(cart.nis, 0.1 s)"}
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
    """The rig of the first paper, simulated in process, with an observer."""

    def __init__(self, interlocks: str = "") -> None:
        path = shipped_folder("configs") / "sim_lugre.yaml"
        text = path.read_text().replace("interlocks:\n", OBSERVERS + interlocks, 1)
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

    def lose_carriage_after(self, rows: int) -> None:
        mounts = self.host.cycle.rig.mounts
        carriage = next(mount.driver for mount in mounts if mount.name == "carriage")
        read, calls = carriage.read, []

        def late(t_ns: int) -> object:
            calls.append(t_ns)
            return read(t_ns) if len(calls) < rows else None

        carriage.read = late  # type: ignore[method-assign, assignment]


def test_state_follows_the_carriage() -> None:
    played = Played()
    assert played.play(duration_s=0.6) is Severity.DONE
    cart, truth = played.sink.of("cart"), played.sink.of("truth")
    late = slice(100, None)
    error = cart["speed"][late] - truth["carriage_speed"][late]
    assert np.sqrt(np.mean(error**2)) < 0.01
    assert np.all(np.isfinite(cart["nis"][late]))
    assert not np.any(cart[STATUS_FIELD][late])
    assert np.array_equal(cart["t_ns"], played.sink.of("carriage")["t_ns"])
    mean = played.sink.of("cart_mean")["nis"]
    assert mean[-1] == pytest.approx(np.mean(cart["nis"][-100:]), rel=1e-6)


def test_condition_ends_step_in_cycle_that_sees_it() -> None:
    played = Played()
    until = ((Condition("cart.speed", Comparison.ABOVE, 0.2),),)
    assert played.play(until=until, duration_s=None, timeout_s=5.0) is Severity.DONE
    speed = played.sink.of("cart")["speed"]
    assert speed[-1] > 0.2
    assert np.nanmax(speed[:-1]) <= 0.2


def test_interlock_acts_when_the_model_stops_fitting() -> None:
    played = Played(
        "  - {name: misfit, source: cart.nis, high: 50, delay: 1 ms, action: abort, "
        "message: The model does not fit.}\n"
    )
    mounts = played.host.cycle.rig.mounts
    carriage = next(mount.driver for mount in mounts if mount.name == "carriage")
    read = carriage.read

    def slipped(t_ns: int) -> object:  # the carriage jumps by 10 mm each cycle
        row = read(t_ns)
        shift = 0.0 if not played.sink.kept else 0.01 * (played.host.cycle.counters.cycles % 7)
        return row if row is None else (row[0] + shift, *row[1:])

    assert played.play(duration_s=0.2) is Severity.DONE
    carriage.read = slipped  # type: ignore[method-assign, assignment]
    assert played.play(duration_s=0.2) is Severity.ABORT


def test_lost_sensor_makes_states_unknown_and_trips() -> None:
    played = Played(
        "  - {name: lost, source: cart.position, high: 9 m, action: abort, message: Lost.}\n"
    )
    played.lose_carriage_after(150)
    assert played.play(duration_s=1.0) is Severity.ABORT
    cart = played.sink.of("cart")
    stale = (cart[STATUS_FIELD] & STALE) != 0
    first = int(np.argmax(stale[20:])) + 20
    assert np.all(np.isnan(cart["nis"][first:]))
    assert np.all(np.diff(cart["position_sd"][first : first + 15]) > 0)
    assert math.isnan(cart["position"][-1])
    assert 15 < int(stale[first:].sum()) <= 18


def test_filter_begins_anew_with_each_trial() -> None:
    played = Played()
    for trial in (1, 2):
        played.host.trial = trial
        played.play(duration_s=0.1)
    wide = np.nonzero(played.sink.of("cart")["speed_sd"] > 0.09)[0]
    assert len(wide) == 2
    assert wide[1] - wide[0] >= 100
