"""Defines the posterior of an identification as frozen data, for tables, reports and JSON."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Mode:
    """A peak of a density, and the share of the draws that belongs to it."""

    value: float
    share: float


@dataclass(frozen=True)
class CredibleInterval:
    """The 95 % credible interval of one parameter around its median ``estimate``, in ``unit``.

    All three are ``None`` if no number may be given; ``sentence`` is the reason. ``r_hat`` and the
    effective draws of ``bulk`` and ``tail`` show how far the chains agree.
    """

    name: str
    symbol: str
    unit: str
    estimate: float | None
    low: float | None
    high: float | None
    r_hat: float
    bulk: float
    tail: float
    modes: tuple[Mode, ...]
    sentence: str

    @property
    def effective(self) -> float:
        """Return the smaller one of the effective sample sizes."""
        return min(self.bulk, self.tail)


@dataclass(frozen=True)
class Ridge:
    """Two parameters that can replace each other, with their rank correlation."""

    first: str
    second: str
    correlation: float


@dataclass(frozen=True, eq=False)
class Posterior:
    """The credible intervals, what the draws show besides, and how they were made.

    ``draws`` (chains, n, q) are natural values of ``parameters``. ``agreed`` is whether the chains
    agree and are long enough; without it no interval is given. ``tempering`` divides -2 ln L, as
    the residuals vary more than white noise.
    """

    agreed: bool
    parameters: tuple[CredibleInterval, ...]
    ridges: tuple[Ridge, ...]
    warnings: tuple[str, ...]
    tempering: float
    seed: int
    evaluations: int
    draws: NDArray[np.float64] = field(repr=False)

    def shape(self) -> dict[str, object]:
        """Return the keys of the JSON object; the draws themselves are not in it."""
        return {
            "agreed": self.agreed,
            "parameters": {item.name: item for item in self.parameters},
            "ridges": self.ridges,
            "warnings": self.warnings,
            "tempering": self.tempering,
            "chains": self.draws.shape[0],
            "draws": self.draws.shape[0] * self.draws.shape[1],
            "evaluations": self.evaluations,
            "seed": self.seed,
        }
