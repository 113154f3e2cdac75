"""A linear filter in the cycle: equal to its textbook form, consistent, NaN when it is lost."""

from __future__ import annotations

import math

import control
import numpy as np
from numpy.typing import NDArray

from rigd.computed.observers.driver import ObserverConfig
from rigd.computed.observers.linear import LinearPlan
from rigd.computed.observers.runner import Runner
from rigd.model.channels import STALE, Channel
from rigd.model.tables import Tables

PERIOD_NS = 1_000_000
START_NS = 1_790_000_000_000_000_000
F = np.array([[1.0, 0.02], [-0.05, 0.9]])
G = np.array([[0.0], [0.3]])
H = np.array([[1.0, 0.0], [0.5, 2.0]])
D = np.array([[0.0], [0.1]])
Q = np.array([[1e-3, 2e-4], [2e-4, 4e-3]])
R = np.array([[0.02, 0.01], [0.01, 0.05]])
P0 = np.array([[2.0, 0.3], [0.3, 1.0]])
X0 = np.array([0.5, -1.0])


class Bench:
    """A filter on tables of one input and two measured channels of a device each."""

    def __init__(self, lost_s: float = 0.02, late_ns: int = 0) -> None:
        plan = LinearPlan(
            f=_tuple(F), g=_tuple(G), h=_tuple(H), d=_tuple(D), q=_tuple(Q), r=_tuple(R),
            x0=tuple(X0.tolist()), p0=_tuple(P0),
        )  # fmt: skip
        config = ObserverConfig(
            plan=plan, channels=(Channel("x"),) * 7, inputs=("u.u",), measured=("a.z", "b.z"),
            period_ns=PERIOD_NS, lost_ns=round(lost_s * 1e9), each_trial=False,
        )  # fmt: skip
        self.runner = Runner(config)
        self.values = [math.nan] * 3
        self.stamps = [0, 0, 0]
        places = {"u.u": 0, "a.z": 1, "b.z": 2}
        self.tables = Tables(
            self.values, self.stamps, [], [], places, [0, 1, 2], [late_ns] * 3, {}
        )  # fmt: skip
        self.runner.bind(self.tables)
        self.slot = 0

    def step(self, u: float | None, a: float | None, b: float | None) -> list[float]:
        """Return the row of the next cycle; None is a channel that gives no new row."""
        self.slot += 1
        now = START_NS + self.slot * PERIOD_NS
        for place, value in enumerate((u, a, b)):
            if value is not None:
                self.values[place], self.stamps[place] = value, now
        self.tables.take(now)
        self.runner.step(now)
        return self.runner.row


def _tuple(matrix: NDArray[np.float64]) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())


def _simulated(steps: int, seed: int) -> tuple[NDArray[np.float64], ...]:
    """Return states (k, 2), inputs (k) and readings (k, 2) of a rig that is as the model."""
    rng = np.random.default_rng(seed)
    x = rng.multivariate_normal(X0, P0)
    u = rng.normal(0.0, 1.0, steps)
    states, readings = np.empty((steps, 2)), np.empty((steps, 2))
    noise = rng.multivariate_normal([0.0, 0.0], Q, steps)
    error = rng.multivariate_normal([0.0, 0.0], R, steps)
    for k in range(steps):
        if k:
            x = F @ x + G[:, 0] * u[k] + noise[k]
        states[k], readings[k] = x, H @ x + D[:, 0] * u[k] + error[k]
    return states, u, readings


def test_filter_equals_its_textbook_form() -> None:
    bench = Bench()
    _, inputs, readings = _simulated(60, 1)
    x, p = X0, P0
    for k, (u, z) in enumerate(zip(inputs, readings, strict=True)):
        if k:
            x, p = F @ x + G[:, 0] * u, F @ p @ F.T + Q
        used = [place for place in (0, 1) if (k + place) % 4]  # each is missing now and then
        h, r = H[used], R[np.ix_(used, used)]
        y = (z - H @ x - D[:, 0] * u)[used]
        s = h @ p @ h.T + r
        gain = p @ h.T @ np.linalg.inv(s)
        x, p = x + gain @ y, (np.eye(2) - gain @ h) @ p
        row = bench.step(u, *(float(z[i]) if i in used else None for i in (0, 1)))
        wanted = [x[0], math.sqrt(p[0, 0]), x[1], math.sqrt(p[1, 1])]
        assert np.allclose(row[:4], wanted, rtol=1e-9, atol=1e-12)
        assert np.allclose([row[4 + i] for i in used], y, rtol=1e-9, atol=1e-12)
        assert all(math.isnan(row[4 + i]) for i in (0, 1) if i not in used)
        assert math.isclose(row[6], y @ np.linalg.inv(s) @ y, rel_tol=1e-8)
        assert row[7] == (0 if len(used) == 2 else STALE)


def test_bands_hold_and_nis_has_its_mean() -> None:
    held, total, nis = 0, 0, []
    for seed in range(120):
        bench = Bench()
        states, inputs, readings = _simulated(60, seed)
        for x, u, z in zip(states, inputs, readings, strict=True):
            row = bench.step(float(u), float(z[0]), float(z[1]))
            held += sum(abs(row[2 * i] - x[i]) < 1.96 * row[2 * i + 1] for i in (0, 1))
            nis.append(row[6])
            total += 2
    assert 0.93 < held / total < 0.97
    assert abs(np.mean(nis) - 2.0) < 0.1


def test_deviation_grows_until_states_are_lost() -> None:
    bench = Bench(lost_s=0.02)
    for _ in range(50):
        row = bench.step(0.0, 0.1, 0.2)
    steady = row[1]
    rows = [bench.step(0.0, None, math.nan) for _ in range(30)]
    deviations = [row[1] for row in rows]
    assert rows[0][1] > steady
    assert np.all(np.diff(deviations[:20]) > 0)
    assert all(math.isnan(value) for row in rows for value in row[4:7])
    assert not any(math.isnan(value) for value in rows[19][:4])
    assert all(math.isnan(value) for row in rows[20:] for value in row[:4])
    assert {row[7] for row in rows} == {STALE}
    again = bench.step(0.0, 0.1, 0.2)  # begins anew, from x0 and p0
    first = Bench().step(0.0, 0.1, 0.2)
    assert again == first


def test_unknown_input_is_held_then_loses_states() -> None:
    bench = Bench(lost_s=0.01)
    for _ in range(20):
        bench.step(1.0, 0.1, 0.2)
    rows = [bench.step(math.nan, 0.1, 0.2) for _ in range(12)]
    assert all(math.isfinite(row[0]) for row in rows[:10])
    assert all(math.isnan(row[0]) for row in rows[10:])
    assert all(row[7] == STALE for row in rows)


def test_nothing_is_known_before_the_first_reading() -> None:
    bench = Bench()
    assert math.isnan(bench.step(None, 0.1, 0.2)[0])  # no input yet
    assert math.isfinite(bench.step(0.0, 0.1, 0.2)[0])


def test_missed_cycles_are_predicted() -> None:
    gapless, other = Bench(), Bench()
    for bench in (gapless, other):
        bench.step(0.5, 0.1, 0.2)
    for _ in range(3):
        gapless.step(0.5, None, None)
    other.slot += 3
    assert np.allclose(gapless.step(0.5, 0.3, 0.1), other.step(0.5, 0.3, 0.1), rtol=1e-13)


def test_cycle_that_stood_too_long_begins_anew() -> None:
    bench, fresh = Bench(lost_s=0.02), Bench(lost_s=0.02)
    for _ in range(5):
        bench.step(0.1, 0.6, -0.9)
    bench.slot += 3_600_000  # an hour without a cycle: not to be made up for in one
    assert bench.step(0.1, 0.7, -0.8) == fresh.step(0.1, 0.7, -0.8)


def test_slow_channel_keeps_its_innovation_between_readings() -> None:
    bench = Bench(late_ns=5 * PERIOD_NS)
    bench.step(0.0, 0.1, 0.2)
    rows = [bench.step(0.0, None, None) for _ in range(8)]
    first = Bench().step(0.0, 0.1, 0.2)
    assert all(row[4:7] == first[4:7] and row[7] == 0 for row in rows[:5])
    assert all(math.isnan(value) for row in rows[5:] for value in row[4:7])
    assert all(row[7] == STALE for row in rows[5:])


def test_overflow_begins_anew() -> None:
    bench = Bench()
    bench.step(0.0, 0.1, 0.2)
    assert math.isnan(bench.step(1e308, 1e308, -1e308)[0])
    assert math.isfinite(bench.step(0.0, 0.1, 0.2)[0])


def test_filter_settles_at_gain_of_python_control() -> None:
    later, before, _ = control.dlqe(F, np.eye(2), H, Q, R)
    gain = np.linalg.solve(F, later)  # that of the next state, a period earlier
    after = before - gain @ H @ before
    bench = Bench()
    for _ in range(400):
        row = bench.step(0.0, 0.0, 0.0)
    assert np.allclose([row[1], row[3]], np.sqrt(np.diag(after)), rtol=1e-9)
    state = np.array([row[0], row[2]])
    for place in (0, 1):
        reading = np.where(np.arange(2) == place, 1.0, 0.0)
        expected = F @ state
        expected = expected + gain @ (reading - H @ expected)
        row = bench.step(0.0, *reading.tolist())
        state = np.array([row[0], row[2]])
        assert np.allclose(state, expected, rtol=1e-9, atol=1e-12)
