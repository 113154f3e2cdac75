"""Is an interval too wide because of the constants? Of which, and how much better must it be?"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from rigd.analysis.fitting.identifiability import Evidence, judge
from rigd.analysis.fitting.model import FitParameter
from rigd.analysis.output_error.estimator import OutputErrorFit, estimate
from rigd.analysis.output_error.innovations import Deviations
from rigd.analysis.output_error.limiting_constant import Owed, owed_to_constants
from rigd.analysis.output_error.system import Output, Unknown
from rigd.analysis.result import FloatArray, Verdict

LIMIT = 0.35
SAMPLES = 50


@dataclass(frozen=True, eq=False)
class Product:
    """Two outputs: a times all constants, and the first constant, with noise of ``sds``."""

    us: tuple[float, ...]
    sds: tuple[float, float]
    shared: tuple[Unknown, ...] = field(init=False)
    local: tuple[Unknown, ...] = ()
    outputs: tuple[Output, ...] = (Output("product", "1"), Output("constant", "1"))

    def __post_init__(self) -> None:
        free = Unknown(FitParameter("a", "1", 1e-3, 1e3, 1.0))
        known = (
            Unknown(FitParameter(f"c{k}", "1", 1e-3, 1e3, 1.0), u, f"constant {k}")
            for k, u in enumerate(self.us)
        )
        object.__setattr__(self, "shared", (free, *known))

    @property
    def measured(self) -> tuple[FloatArray, ...]:
        noise = np.random.default_rng(1).standard_normal((SAMPLES, 2))
        return (1.0 + noise * np.array(self.sds),)

    def simulate(self, trial: int, shared: FloatArray, local: FloatArray) -> FloatArray:
        return np.tile([np.prod(shared), shared[1]], (SAMPLES, 1))

    def linearise(
        self, trial: int, shared: FloatArray, local: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        slopes = np.zeros((SAMPLES, 2, shared.size))
        slopes[:, 0] = np.prod(shared) / shared
        slopes[:, 1, 1] = 1.0
        return self.simulate(trial, shared, local), slopes

    def deviations(self, trial: int, shared: FloatArray, local: FloatArray) -> Deviations:
        still = np.ones((SAMPLES, 1, 1))
        return Deviations(
            still, np.zeros((SAMPLES, 1)), np.zeros((SAMPLES, 2, 1)),
            np.tile(np.square(self.sds), (SAMPLES, 1)), np.zeros(1), np.eye(2),
        )  # fmt: skip


def fitted(us: tuple[float, ...], sds: tuple[float, float]) -> tuple[OutputErrorFit, float]:
    """Return the fit, and the standard deviation of ln a."""
    found = estimate(Product(us, sds), [np.ones(1 + len(us))], 5)
    return found, float(np.sqrt(found.covariance[0, 0]))


def owed(us: tuple[float, ...], sds: tuple[float, float]) -> Owed | None:
    found, spread = fitted(us, sds)
    return owed_to_constants(found, np.eye(1 + len(us))[0], spread, LIMIT, {})


@pytest.mark.parametrize("second_sd", [100.0, 5.0])
def test_smaller_u_as_named_reaches_the_limit(second_sd: float) -> None:
    us, sds = (0.8, 0.1), (0.01, second_sd)
    found = owed(us, sds)
    assert found is not None and found.smaller is not None
    assert found.name == "constant 0"
    assert found.smaller > 1.2
    assert fitted((us[0] / found.smaller, us[1]), sds)[1] == pytest.approx(LIMIT, rel=0.05)


def test_two_constants_must_both_be_better() -> None:
    found = owed((0.4, 0.45), (0.01, 100.0))
    assert found is not None
    assert (found.name, found.smaller) == ("constant 1", None)
    assert "not only this constant" in found.sentence


@pytest.mark.parametrize(
    ("us", "sds"),
    [
        ((0.1, 0.1), (4.0, 100.0)),  # the noise is the reason
        ((0.6, 0.1), (3.5, 100.0)),  # exact constants would not be enough
        ((0.3, 0.1), (0.01, 100.0)),  # within the limit
    ],
)
def test_constants_are_not_blamed(us: tuple[float, ...], sds: tuple[float, float]) -> None:
    assert owed(us, sds) is None


def test_constant_beside_the_fit_is_named() -> None:
    found, spread = fitted((0.1,), (0.01, 100.0))
    whole = float(np.hypot(spread, 0.6))
    named = owed_to_constants(found, np.eye(2)[0], whole, LIMIT, {"gravity": 0.6})
    assert named is not None and named.smaller is not None
    assert named.name == "gravity"
    assert np.hypot(spread, 0.6 / named.smaller) == pytest.approx(LIMIT, rel=1e-6)


def test_verdict_names_the_constant_and_its_u() -> None:
    found = owed((0.8, 0.1), (0.01, 100.0))
    assert found is not None
    verdict, sentence = judge(Evidence(1.0, 0.2, 5.0, "1", owed=found.sentence))
    assert verdict is Verdict.CONSTANTS
    assert sentence.startswith("The constants allow anything from 0.2 to 5.")
    assert "constant 0: its u must be 2.4 times smaller." in sentence
