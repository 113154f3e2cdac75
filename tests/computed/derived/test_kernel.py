"""The compiled graph: equal to a slow second form for any formula, and to closed forms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import signal
from support.engine.formula_draws import DrawnChannel, channels, formulas
from support.engine.formula_reference import Part

from rigd.computed.derived.driver import DerivedConfig
from rigd.computed.derived.evaluator import Evaluator
from rigd.computed.derived.formula import read_formula
from rigd.computed.derived.graph import Builder, Graph
from rigd.config.loader import parse_rig
from rigd.language.number import Number
from rigd.model.tables import Tables

PERIOD_NS = 1_000_000
START_NS = 1_790_000_000_000_000_000


class Connected:
    """The channels of a graph on tables of two devices, with a channel each (``inputs``).

    The tables have the values and times of the devices, then the rows and times of the groups; then
    the times have those of the oldest reading in each channel.
    """

    def __init__(self, graph: Graph, inputs: tuple[str, str]) -> None:
        groups, rows, width = graph.groups(), dict[str, tuple[int, int]](), 2
        for place, (group, names) in enumerate(groups.items(), 2):
            rows[group] = width, place
            width += len(names) + 1
        self.taken = 2 + len(groups)
        self.values = [math.nan] * width
        self.stamps = [START_NS] * (self.taken + len(graph.outputs))
        readings = {name: place for place, name in enumerate(inputs)}
        self.tables = Tables(
            self.values, self.stamps, [], [], readings, (0, 1), (0, 0), {}, rows, (2, 2), self.taken
        )
        self.evaluator = Evaluator(graph)
        self.evaluator.bind(self.tables, self.taken)
        self.show = self.tables.shows(slice(2, width), slice(2, len(self.stamps)))

    def compute(self, t_ns: int) -> None:
        self.tables.take(t_ns)
        self.evaluator.compute(t_ns)
        self.show()


class Bound(Connected):
    """A formula of the channels ``dev_a.x`` and ``dev_b.x``, played cycle by cycle."""

    def __init__(self, text: str, *, reset: bool = False) -> None:
        builder = Builder(PERIOD_NS * 1e-9, reset=reset)

        def find(name: str, offset: int) -> Number:
            return builder.input(name, (0,) * 7, frozenset({name}))

        term = read_formula(text, builder, find)
        row = builder.place(term)
        graph = Graph(
            tuple(builder.rows), tuple(builder.parameters), builder.states, tuple(builder.inputs),
            {"f.x": row}, {"f.x": term.uses},
        )  # fmt: skip
        super().__init__(graph, ("dev_a.x", "dev_b.x"))

    def cycle(self, number: int, a: float | None, b: float | None = None) -> float:
        """Return the value of cycle ``number``; None is a device without a new row."""
        t_ns = START_NS + number * PERIOD_NS
        for device, value in enumerate((a, b)):
            if value is not None:
                self.values[device], self.stamps[device] = value, t_ns
        self.compute(t_ns)
        return self.values[2]

    def play(self, values: Sequence[float]) -> list[float]:
        return [self.cycle(number, value) for number, value in enumerate(values)]


readings = st.one_of(st.none(), st.sampled_from([-2.0, -0.125, 0.0, 0.25, 1.5, 4.0, math.nan]))


@settings(max_examples=100, deadline=None)
@given(formula=formulas, rows=st.lists(st.tuples(readings, readings), min_size=1, max_size=25))
def test_compiled_graph_equals_slow_second_form(
    formula: Part, rows: list[tuple[float | None, float | None]]
) -> None:
    bound = Bound(formula.text())
    inputs, times = {"a": math.nan, "b": math.nan}, {"a": 0.0, "b": 0.0}
    for number, (a, b) in enumerate(rows):
        now_s = number * 1e-3
        for name, value in (("a", a), ("b", b)):
            if value is not None:
                inputs[name], times[name] = value, now_s
        expected = formula.value(inputs, times)
        found = bound.cycle(number, a, b)
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-9, nan_ok=True), number
        oldest = (bound.stamps[bound.taken] - START_NS) * 1e-9
        assert oldest == pytest.approx(formula.oldest(times, now_s), abs=1e-9)


RIG = """\
rig: any-1
title: Any channels
cycle: 1 kHz
plant: {model: lugre, floor: pvc}
devices:
  wheel_encoder: {driver: sim-lugre-encoder, options: {axis: wheel}}
  carriage: {driver: sim-lugre-encoder, options: {axis: carriage}}
interlocks: []
derived:
  dev_a.x: {is: wheel_encoder.angle / 1 rad}
  dev_b.x: {is: carriage.position / 1 m}
"""


@settings(max_examples=40, deadline=None)
@given(drawn=channels(), rows=st.lists(st.tuples(readings, readings), min_size=1, max_size=25))
def test_channels_of_file_equal_slow_second_form(
    drawn: list[DrawnChannel], rows: list[tuple[float | None, float | None]]
) -> None:
    """With the keys `where` and `lowpass`, and channels that use others."""
    rig = parse_rig(RIG + "".join(channel.line for channel in drawn), Path("rig.yaml"))
    configs = (device.config for device in rig.devices.values())
    graph = next(config.graph for config in configs if isinstance(config, DerivedConfig))
    bound = Connected(graph, ("wheel_encoder.angle", "carriage.position"))
    inputs, times = {"a": math.nan, "b": math.nan}, {"a": 0.0, "b": 0.0}
    for number, row in enumerate(rows):
        now_s = number * 1e-3
        for place, (name, value) in enumerate(zip(inputs, row, strict=True)):
            if value is not None:
                inputs[name], times[name] = value, now_s
                bound.values[place], bound.stamps[place] = value, START_NS + number * PERIOD_NS
        bound.compute(START_NS + number * PERIOD_NS)
        for place, channel in enumerate(drawn, 2):
            expected = channel.part.value(inputs, times)
            found = bound.values[2 + 2 * place]  # each is followed by the status of its group
            assert found == pytest.approx(expected, rel=1e-6, abs=1e-6, nan_ok=True), channel.line
            oldest = (bound.stamps[bound.taken + place] - START_NS) * 1e-9
            assert oldest == pytest.approx(channel.part.oldest(times, now_s), abs=1e-9)


@settings(max_examples=100, deadline=None)
@given(
    formula=formulas,
    rows=st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=1, max_size=25),
)
def test_no_reading_makes_a_value_infinite(formula: Part, rows: list[float]) -> None:
    bound = Bound(formula.text())
    for number, value in enumerate(rows):
        assert not math.isinf(bound.cycle(number, value, value))


def test_low_pass_has_step_response_of_butterworth() -> None:
    found = Bound("lowpass(dev_a.x, 50 Hz)").play([0.0] + 60 * [1.0])
    system = signal.butter(2, 2 * math.pi * 50, analog=True)
    _, expected = signal.step(system, T=np.arange(61) * 1e-3)
    assert found == pytest.approx(expected, abs=1e-9)


def test_low_pass_delays_ramp_by_stated_time() -> None:
    found = Bound("lowpass(dev_a.x, 20 Hz)").play([1e-3 * n for n in range(400)])
    delay_s = math.sqrt(2) / (2 * math.pi * 20)
    # A reading counts from the one before on, which is half a cycle less.
    assert 0.399 - found[-1] == pytest.approx(delay_s - 0.5e-3, rel=1e-3)


def test_slow_channel_is_differentiated_over_its_own_interval() -> None:
    bound = Bound("derivative(dev_a.x)")
    found = [bound.cycle(n, 0.5 * n if n % 40 == 0 else None) for n in range(200)]
    assert found[40:] == pytest.approx([500.0] * 160)


def test_integral_of_sine_is_cosine() -> None:
    times = np.arange(1000) * 1e-3
    found = Bound("integral(dev_a.x)").play([math.sin(7 * t) for t in times])
    assert found == pytest.approx((1 - np.cos(7 * times)) / 7, abs=2e-6)


def test_integral_over_unknown_value_stays_unknown_until_reset() -> None:
    bound = Bound("integral(dev_a.x)", reset=True)
    found = bound.play([1.0, 1.0, math.nan, 1.0, 1.0])
    assert found[:2] == pytest.approx([0.0, 1e-3])
    assert all(math.isnan(value) for value in found[2:])
    bound.evaluator.begin_trial(1)
    assert [bound.cycle(n, 1.0) for n in (5, 6)] == pytest.approx([0.0, 1e-3])


def test_reset_belongs_to_channels_that_ask_for_it() -> None:
    bound = Bound("integral(dev_a.x)")
    bound.play([1.0, 1.0])
    bound.evaluator.begin_trial(1)
    assert bound.cycle(2, 1.0) == pytest.approx(2e-3)


def test_table_interpolates_and_is_unknown_beyond() -> None:
    bound = Bound("lookup(dev_a.x, [0, 1, 3], [10, 20, 0])")
    assert bound.play([0.0, 0.5, 1.0, 2.0, 3.0, 3.1, -0.1, math.nan]) == pytest.approx(
        [10, 15, 20, 10, 0, math.nan, math.nan, math.nan], nan_ok=True
    )


def test_long_window_keeps_its_digits() -> None:
    rng = np.random.default_rng(1)
    values = np.concatenate((1e9 * rng.normal(size=2000), rng.normal(size=3000)))
    found = Bound("mean(dev_a.x, 1 s)").play(values.tolist())
    assert found[-1] == pytest.approx(float(np.mean(values[-1000:])), abs=1e-12)


def test_low_pass_equals_sampled_filter_of_python_control() -> None:
    omega = 2 * math.pi * 80
    sampled = control.tf([omega**2], [1, math.sqrt(2) * omega, omega**2]).sample(1e-3, "zoh")
    values = np.random.default_rng(5).normal(size=300)
    values[0] = 0.0
    # A reading counts from the one before on.
    expected = control.forced_response(sampled, U=np.append(values[1:], 0.0)).outputs
    assert Bound("lowpass(dev_a.x, 80 Hz)").play(values.tolist()) == pytest.approx(
        expected, rel=1e-9, abs=1e-12
    )
