"""`check_friction_law` finds what a law promises and does not keep: one broken one per rule."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from rigd.analysis.friction import FrictionLaw, LawParameter, gradient, step
from rigd.analysis.friction.check import check_friction_law, examine_friction_law
from rigd.analysis.friction.compiled_law import Gradient
from rigd.analysis.kernel import kernel
from rigd.analysis.result import FloatArray
from rigd.sdk.check import NonConforming

STRENGTH = LawParameter("strength", "1", 1e-2, 10.0, 0.3, symbol="a", meaning="friction far out")
SPEED = LawParameter("speed", "m/s", 1e-3, 1.0, 0.05, symbol="v", meaning="slip of the bend")


@step
def smooth(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    return float(theta[0] * np.tanh(slip / theta[1]))


@kernel
def bent(theta: FloatArray, slip: float, row: FloatArray) -> float:
    """Return the force that `smooth` has, and write its derivatives to ``row`` (2,)."""
    bend = np.tanh(slip / theta[1])
    row[0] = bend
    row[1] = -theta[0] * (1.0 - bend**2) * slip / theta[1] ** 2
    return float(theta[0] * bend)


@gradient
def smooth_gradient(
    state: FloatArray, sensitivity: FloatArray, theta: FloatArray,
    between: float, slip: float, rolling: float, dt: float, row: FloatArray,
) -> float:  # fmt: skip
    return bent(theta, slip, row)


class Smooth(FrictionLaw):
    """Friction that bends over: a tanh(V/v)."""

    parameters = (STRENGTH, SPEED)
    step = smooth
    gradient: ClassVar[Gradient | None] = smooth_gradient

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        return np.asarray(theta[0] * np.tanh(slip_m_s / theta[1]))


@step
def dividing(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    return float(theta[0] * slip / np.sqrt(slip**2))


@step
def preloaded(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    return float(theta[0] * np.tanh(slip / theta[1]) + 0.01)


@step
def opposed(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    return float(-theta[0] * np.tanh(slip / theta[1]))


@step
def creeping(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    state[0] += between * dt
    return float(theta[0] * np.tanh(slip / theta[1]) + state[0])


@step
def rippled(
    state: FloatArray, theta: FloatArray, between: float, slip: float, rolling: float, dt: float
) -> float:
    return float(theta[0] * np.sin(slip / theta[1]))


@gradient
def wrong_gradient(
    state: FloatArray, sensitivity: FloatArray, theta: FloatArray,
    between: float, slip: float, rolling: float, dt: float, row: FloatArray,
) -> float:  # fmt: skip
    force = bent(theta, slip, row)
    row[1] *= theta[1]
    return force


@gradient
def another_force(
    state: FloatArray, sensitivity: FloatArray, theta: FloatArray,
    between: float, slip: float, rolling: float, dt: float, row: FloatArray,
) -> float:  # fmt: skip
    return 1.01 * bent(theta, slip, row)


class NoSymbol(Smooth):
    """A parameter without a symbol."""

    parameters = (LawParameter("strength", "1", 1e-2, 10.0, 0.3, meaning="friction"), SPEED)


class NoUnit(Smooth):
    """A parameter in a unit that does not exist."""

    parameters = (
        LawParameter("strength", "furlong", 1e-2, 10.0, 0.3, symbol="a", meaning="friction"),
        SPEED,
    )


class Twice(Smooth):
    """Two parameters of one name."""

    parameters = (STRENGTH, STRENGTH)


class Nameless(Smooth):
    parameters = (STRENGTH, SPEED)


class Dividing(Smooth):
    """A force that is no number at rest."""

    step = dividing
    gradient = None


class Preloaded(Smooth):
    """A force at rest."""

    step = preloaded
    gradient = None


class Opposed(Smooth):
    """A force against the convention of signs."""

    step = opposed
    gradient = None

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        return np.asarray(-theta[0] * np.tanh(slip_m_s / theta[1]))


class Creeping(Smooth):
    """A force that never settles."""

    states = 1
    step = creeping
    gradient = None


class Rippled(Smooth):
    """A cost with hundreds of valleys."""

    parameters = (
        STRENGTH,
        LawParameter("speed", "m/s", 1e-4, 1e-2, 1e-3, symbol="v", meaning="slip of a ripple"),
    )
    step = rippled
    gradient = None

    @staticmethod
    def steady(theta: FloatArray, slip_m_s: FloatArray, rolling_m_s: float) -> FloatArray:
        return np.asarray(theta[0] * np.sin(slip_m_s / theta[1]))


class WrongGradient(Smooth):
    """A derivative with a missing square."""

    gradient = wrong_gradient


class AnotherForce(Smooth):
    """A gradient that returns another force than the step."""

    gradient = another_force


def test_a_law_that_keeps_every_rule_passes() -> None:
    report = check_friction_law(Smooth)
    assert len(report.checked) == 8
    assert report.skipped == {}


@pytest.mark.parametrize(
    ("law", "rule", "said"),
    [
        (NoSymbol, "declares its parameters", "strength has no symbol"),
        (NoUnit, "declares its parameters", "furlong"),
        (Twice, "declares its parameters", "two parameters are called strength"),
        (Nameless, "declares its parameters", "no docstring"),
        (Dividing, "gives a number at any slip", "no number at strength"),
        (Preloaded, "gives no force without slip", "a force at rest"),
        (Opposed, "opposes the slip", "not the sign"),
        (Creeping, "settles at its steady force", "`steady` returns"),
        (Rippled, "is found again from its own force", "eight fits"),
        (WrongGradient, "has right derivatives", "derivative by speed"),
        (AnotherForce, "has right derivatives", "another force than `step`"),
    ],
)
def test_a_broken_rule_is_named(law: type[FrictionLaw], rule: str, said: str) -> None:
    findings = {finding.rule: finding for finding in examine_friction_law(law).findings}
    assert rule in findings
    assert said in findings[rule].problem
    assert findings[rule].demand
    with pytest.raises(NonConforming, match="rules broken"):
        check_friction_law(law)
