"""The filter of slip: equal to one in numpy, near the truth, NaN when it is lost."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support.commands.command import rigd
from support.lugre.slip import MISFIT, STONE, observer, score, slip_rig, with_filter

from rigd.analysis.recordings.observers import filtered
from rigd.computed.observers.driver import ObserverConfig
from rigd.computed.observers.memory import Memory
from rigd.config.loader import load_rig, parse_rig
from rigd.daemon.execute import RunRequest, perform
from rigd.engine.play.control import Control
from rigd.engine.run.result import RunResult
from rigd.model.tables import Tables
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.record import Recording, RecordingWriter

Floats = NDArray[np.float64]
PERIOD_S = 1e-3
#: States of the filter in its own order, in the words of the equations.
THETA, V, W, Z, PUSH, TORQUE, ZERO, SCALE, GAIN, C1, S1, C2, S2 = range(13)
DRIFT = """\
interlocks:
  - {name: misfit, source: fit.nis, high: 4, action: end_trial, message: The model does not fit.}
"""


def played(
    folder: Path, output: str, rig: Path, procedure: str = "quick", **sets: str
) -> RunResult:
    loaded, source = load_rig(str(rig)), load_procedure(procedure)
    compiled = compile_procedure(source, loaded, sets)
    request = RunRequest(compiled, source.file.text, loaded, 5, output=folder / output)
    return perform(request, Control()).result


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of one drive at 1.35 A on stone, with the filter."""
    folder = tmp_path_factory.mktemp("slip")
    played(folder, "run.mcap", slip_rig(folder / "rig", observer()))
    return folder / "run.mcap"


def test_slip_is_near_the_truth(driven: Path) -> None:
    found = score(driven)
    assert found.rms_mm_s < 1.5
    assert found.odometry_mm_s > 50
    assert found.held > 0.9
    assert found.nis < 2.5


def test_belt_that_holds_is_followed(driven: Path) -> None:
    assert score(driven, "brake").held > 0.8
    recording = Recording.open(driven)
    row, truth = recording.read("slip_filter"), recording.read("truth")
    assert np.all(np.isfinite(row["slip"]))
    error = row["speed"] - truth["carriage_speed"]
    assert np.abs(error).max() < 0.02


def test_recording_gives_the_same_rows(driven: Path) -> None:
    output = driven.with_name("again.mcap")
    rig = driven.parent / "rig" / "rig.yaml"
    ended = rigd("filter", driven, "--rig", rig, "--output", output, cwd=driven.parent)
    assert ended.code == 0, ended.err
    assert "trial 1" in ended.out
    live, again = Recording.open(driven), Recording.open(output)
    assert live.read("slip_filter").tobytes() == again.read("slip_filter").tobytes()
    assert len(again.trials) == len(live.trials) == 1


def test_rows_between_cycles_do_not_count(driven: Path) -> None:
    """A card is recorded with all its rows; a cycle uses the newest."""
    run = Recording.open(driven)
    rows = {name: run.read(name) for name in run.streams}
    fast = np.repeat(rows["accelerometer"], 4)
    between = np.arange(len(fast)) % 4 < 3
    fast["t_ns"][between] -= (750_000, 500_000, 250_000) * len(rows["accelerometer"])
    fast["acceleration"][between] = 99.0
    output = driven.with_name("fast.mcap")
    with RecordingWriter.create(
        output,
        streams=list(run.streams.values()),
        metadata={},
        attachments=(),
        start_ns=int(fast["t_ns"][0]),
    ) as writer:
        for name, given in {**rows, "accelerometer": fast}.items():
            writer.write(name, given)
    rig = load_rig(str(driven.parent / "rig" / "rig.yaml"))
    found = filtered(Recording.open(output), rig, "slip_filter").rows
    assert np.array_equal(found["slip"], rows["slip_filter"]["slip"])


def test_recording_without_a_channel_is_named(driven: Path) -> None:
    rig = driven.parent / "rig" / "rig.yaml"
    only_slip = driven.with_name("only.mcap")
    rigd("filter", driven, "--rig", rig, "--output", only_slip, cwd=driven.parent)
    ended = rigd("filter", only_slip, "--rig", rig, cwd=driven.parent)
    assert ended.code == 7
    assert "has no stream 'wheel_servo', which the observer uses" in ended.err


def test_wrong_friction_trips_an_interlock(tmp_path: Path) -> None:
    twice = {**STONE, "sigma_2": 2 * STONE["sigma_2"]}
    rig = slip_rig(tmp_path / "rig", observer(twice), MISFIT)
    text = rig.read_text("utf-8")
    rig.write_text(text.replace("interlocks:\n", DRIFT, 1), "utf-8")
    played(tmp_path, "run.mcap", rig)
    events = Recording.open(tmp_path / "run.mcap").events()
    assert any("misfit" in str(event.data) for event in events)


class Reference:
    """The same filter in numpy: equations written again, derivatives by differences."""

    def __init__(self, config: ObserverConfig) -> None:
        plan = config.plan
        self.q, fixed = np.array(plan.q), plan.fixed
        self.mass, self.normal, self.transitions = fixed[:3]
        self.steps = int(fixed[3])
        self.current_sd, (self.push_sd, self.torque_sd) = fixed[4], (fixed[6], fixed[8])
        self.x, self.p = np.zeros(13), np.diag(np.array(plan.deviations) ** 2)
        self.r = np.diag(np.array(plan.noise) ** 2)

    def rates(self, x: Floats, current: float) -> Floats:
        """Return dx/dt, from lugre.md section 2."""
        v_s, mu_c, log_ratio, s_0, s_1, s_2, gain, dry, viscous, inertia, guide, roll = self.q[:12]
        radius, normal = self.q[14], self.normal * (1 + x[SCALE])
        slip = radius * x[W] - x[V]
        g = mu_c + mu_c * math.expm1(log_ratio) * math.exp(-math.sqrt(abs(slip) / v_s))
        u = slip - abs(slip) * x[Z] / g
        force = normal * (x[Z] + s_1 * u + s_2 * slip)
        phase = self.transitions * x[THETA]
        shaken = x[V] * (x[C1] * math.cos(phase) + x[S1] * math.sin(phase))
        drag = (guide + roll * self.normal) * math.tanh(x[V] / 1e-3)
        torque = gain * (1 + x[GAIN]) * (current + x[TORQUE]) - viscous * x[W]
        torque -= dry * math.tanh(radius * x[W] / 1e-3) + radius * force
        rates = np.zeros(13)
        rates[:4] = x[W], (force - drag) / self.mass + shaken + x[PUSH], torque / inertia, s_0 * u
        return rates

    def carried(self, x: Floats, current: float) -> Floats:
        """Return the state after a period."""
        h = PERIOD_S / self.steps
        for _ in range(self.steps):
            a = self.rates(x, current)
            b = self.rates(x + h / 2 * a, current)
            c = self.rates(x + h / 2 * b, current)
            d = self.rates(x + h * c, current)
            x = x + h / 6 * (a + 2 * b + 2 * c + d)
        end = x.copy()
        fade = math.exp(-PERIOD_S)
        end[PUSH], end[TORQUE] = fade * x[PUSH], fade * x[TORQUE]
        return end

    def outputs(self, x: Floats, current: float) -> Floats:
        phase = 2 * self.transitions * x[THETA]
        shake = x[C2] * math.cos(phase) + x[S2] * math.sin(phase)
        return np.array([x[THETA], self.rates(x, current)[V] + x[ZERO] + x[V] * shake])

    def predict(self, current: float) -> None:
        f = slopes(lambda x: self.carried(x, current), self.x)
        q = np.zeros((13, 13))
        rest = 1 - math.exp(-2 * PERIOD_S)
        q[PUSH, PUSH], q[TORQUE, TORQUE] = rest * self.push_sd**2, rest * self.torque_sd**2
        q[W, W] = (self.q[6] / self.q[9] * self.current_sd * PERIOD_S) ** 2
        q[V, V], q[ZERO, ZERO] = 1e-7 * PERIOD_S, 1e-8 * PERIOD_S
        self.x, self.p = self.carried(self.x, current), f @ self.p @ f.T + q

    def correct(self, measured: Floats, current: float) -> Floats:
        """Return the innovations."""
        h = slopes(lambda x: self.outputs(x, current), self.x)
        off = measured - self.outputs(self.x, current)
        gain = self.p @ h.T @ np.linalg.inv(h @ self.p @ h.T + self.r)
        gain[SCALE] = 0.0
        keep = np.eye(13) - gain @ h
        self.x, self.p = self.x + gain @ off, keep @ self.p @ keep.T + gain @ self.r @ gain.T
        return np.asarray(off)


def slopes(function: Any, x: Floats) -> Floats:
    """Return the derivatives of ``function`` at ``x`` by central differences."""
    columns = []
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = 1e-6
        columns.append((function(x + step) - function(x - step)) / 2e-6)
    return np.array(columns).T


def connected(memory: Memory) -> Tables:
    """Return tables with what ``memory`` takes: current, carriage held, angle, acceleration."""
    readings = {f"rig.{place}": place for place in range(4)}
    tables = Tables([math.nan] * 4, [0], [], [], readings, [0] * 4, [0], {})
    memory.bind(tables, list(readings))
    return tables


def test_steps_equal_an_independent_filter(tmp_path: Path) -> None:
    config = load_rig(str(slip_rig(tmp_path / "rig", observer()))).devices["slip_filter"].config
    assert isinstance(config, ObserverConfig)
    memory = Memory(2, 2, 3, 1_000_000, 10**9)
    own, reference = config.plan.filter(memory), Reference(config)
    tables = connected(memory)
    random, angle, before = np.random.default_rng(1), 0.0, 0.0
    for k in range(45):
        now = 1_790_000_000_000_000_000 + k * 1_000_000
        current = 0.8 + 0.3 * math.sin(k / 9) + 0.006 * random.standard_normal()
        angle += 0.02 * k * PERIOD_S
        measured = np.array([angle, 0.6 + 0.03 * random.standard_normal()])
        tables.values[:], tables.stamps[:] = (current, 0.0, *measured), [now]
        tables.take(now)
        own.step(now, tables.words)
        if k:
            reference.predict((current + before) / 2)
        off, before = reference.correct(measured, current), current
        x, p = reference.x, reference.p
        to_slip = np.zeros(13)
        to_slip[[W, V]] = 0.05, -1.0
        wanted = [to_slip @ x, math.sqrt(to_slip @ p @ to_slip), x[V], math.sqrt(p[V, V])]
        assert np.allclose(memory.row[:4], wanted, rtol=5e-4, atol=1e-6), k
        assert np.allclose(memory.row[6:8], off, rtol=1e-3, atol=1e-6), k


def test_lost_current_loses_the_slip() -> None:
    rows = stepped({"current": math.nan})
    assert np.all(np.isfinite(rows[0]))
    assert math.isnan(rows[-1][0])


@pytest.mark.parametrize("missing", ["angle", "acceleration"])
def test_missing_reading_widens_the_band(missing: str) -> None:
    whole, rows = stepped({}), stepped({missing: math.nan})
    innovations = dict(zip(("angle", "acceleration"), rows[-1][6:8], strict=True))
    assert np.all(np.isfinite(rows[-1][:6]))
    assert rows[-1][1] > whole[-1][1]
    assert rows[-1][3] > whole[-1][3] * 1.000001
    assert [math.isnan(off) for off in innovations.values()] == [
        name == missing for name in innovations
    ]
    assert math.isfinite(rows[-1][8])  # NIS of the other


def test_nothing_measured_loses_the_slip() -> None:
    rows = stepped({"angle": math.nan, "acceleration": math.nan})
    assert math.isfinite(rows[25][0])
    assert math.isnan(rows[-1][0])


def test_blocked_wheel_shows_in_nis() -> None:
    rows = stepped({"current": 1.0})  # driven, and neither wheel nor carriage moves
    assert all(math.isfinite(row[0]) for row in rows)
    assert np.mean([row[8] for row in rows[:20]]) < 2
    assert np.mean([row[8] for row in rows[20:]]) > 20


def test_divergence_is_named() -> None:
    rows = stepped({"angle": 1e308, "acceleration": 1e308})
    marked = [int(row[-1]) & 1 << 30 for row in rows]
    assert any(marked)
    assert all(math.isnan(row[0]) for row, mark in zip(rows, marked, strict=True) if mark)


def stepped(later: Mapping[str, float]) -> list[Floats]:
    """Return rows of a filter whose readings are as ``later`` after 20 cycles."""
    path = load_rig("lugre-1").source.path
    rig = parse_rig(with_filter(path.read_text("utf-8"), observer()), path)
    memory = Memory(2, 2, 3, 1_000_000, 10_000_000)
    config = rig.devices["slip_filter"].config
    assert isinstance(config, ObserverConfig)
    own, rows = config.plan.filter(memory), []
    tables = connected(memory)
    for k in range(40):
        now = 1_790_000_000_000_000_000 + k * 1_000_000
        given = {"current": 0.0, "held": 0.0, "angle": 0.0, "acceleration": 0.0}
        tables.values[:] = ({**given, **later} if k > 19 else given).values()
        tables.stamps[:] = [now]
        tables.take(now)
        own.step(now, tables.words)
        rows.append(memory.row.copy())
    return rows
