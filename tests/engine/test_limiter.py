"""No command passes the limiter that breaks a limit."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from rigd.engine.cycle.limiter import Limiter
from rigd.model.limits import SetpointLimit

PERIOD_S = 1e-3
anything = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-3, 3), st.just(0.0))


@st.composite
def limits(draw: st.DrawFn) -> SetpointLimit:
    low = draw(st.floats(-10, 0))
    high = draw(st.floats(0, 10))
    rate = draw(st.one_of(st.just(math.inf), st.floats(1e-3, 1e4)))
    return SetpointLimit(low, high, rate, rest=draw(st.floats(low, high)))


@given(limits(), st.lists(anything, max_size=40))
def test_value_and_rate_hold_for_any_commands(limit: SetpointLimit, commands: list[float]) -> None:
    limiter = Limiter([limit], PERIOD_S)
    last = limit.rest
    for command in commands:
        (value,) = limiter.apply([command])
        assert limit.low <= value <= limit.high
        # One rounding error of the larger operand is all that may stand above the rate.
        slack = 4 * math.ulp(max(abs(last), abs(value), 1.0))
        assert abs(value - last) <= limit.rate * PERIOD_S + slack
        last = value


def test_a_command_within_limits_passes_unchanged() -> None:
    limiter = Limiter([SetpointLimit(-1, 1)], PERIOD_S)
    assert limiter.apply([0.123456789]) == [0.123456789]
    assert not limiter.cut


def test_non_finite_command_holds_the_last_one() -> None:
    limiter = Limiter([SetpointLimit(-1, 1)], PERIOD_S)
    limiter.apply([0.5])
    for bad in (math.nan, math.inf, -math.inf):
        assert limiter.apply([bad]) == [0.5]
        assert limiter.cut == {0}


def test_rest_is_reached_exactly_within_the_rate() -> None:
    limiter = Limiter([SetpointLimit(-1, 1, rate=3.0)], PERIOD_S)
    for _ in range(400):
        limiter.apply([1.0])
    cycles = 0
    while not limiter.at_rest():
        limiter.apply([0.0])
        cycles += 1
    assert cycles == 334  # 1 / (3 per s * 1 ms), rounded up
