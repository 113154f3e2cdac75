"""How often intervals hold the truth, and whether a study varies enough to show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.stats import binomtest

#: Estimate, low and high of one experiment, each over the truth; None if no number is quoted.
Found = tuple[float, float | None, float | None]
#: The standard deviation of errors over the half width of an interval, as it is where an interval
#: of 95 % is right and errors are normal.
RIGHT_RATIO: Final = 0.51
#: Below this share of :data:`RIGHT_RATIO` errors vary so little that coverage has no meaning.
TOO_LITTLE: Final = 0.2


@dataclass(frozen=True)
class Coverage:
    """Of one quantity over many experiments; errors and widths in % of the truth.

    ``bias``, ``sd``, ``worst`` are those of the quoted estimates, of all if none is quoted;
    ``half_width`` is the mean over the quoted intervals, NaN without.
    """

    experiments: int
    quoted: int
    covered: int
    bias: float
    sd: float
    worst: float
    half_width: float

    @property
    def share(self) -> float:
        """Share of the quoted intervals that hold the truth, in %; NaN if none is quoted."""
        return 100.0 * self.covered / self.quoted if self.quoted else float("nan")

    @property
    def limits(self) -> tuple[float, float]:
        """What that share may be in truth, in %: 95 % by Clopper and Pearson (1934)."""
        if not self.quoted:
            return 0.0, 100.0
        found = binomtest(self.covered, self.quoted).proportion_ci(0.95, "exact")
        return 100.0 * float(found.low), 100.0 * float(found.high)

    @property
    def ratio(self) -> float:
        """How much errors spread, over the half width: about 0.5 if intervals are right."""
        return self.sd / self.half_width

    @property
    def varies(self) -> bool:
        """Whether experiments differ enough for their coverage to have a meaning."""
        return bool(self.ratio >= TOO_LITTLE * RIGHT_RATIO)


def coverage(found: Sequence[Found]) -> Coverage:
    """Return the coverage of ``found``, one quantity in several experiments."""
    quoted = [(e, low, high) for e, low, high in found if low is not None and high is not None]
    errors = 100.0 * (np.array([item[0] for item in (quoted or found)]) - 1.0)
    widths = [50.0 * (high - low) for _, low, high in quoted]
    return Coverage(
        experiments=len(found),
        quoted=len(quoted),
        covered=sum(low <= 1.0 <= high for _, low, high in quoted),
        bias=float(np.mean(errors)),
        sd=float(np.std(errors, ddof=1)) if len(errors) > 1 else float("nan"),
        worst=float(np.max(np.abs(errors))),
        half_width=float(np.mean(widths)) if widths else float("nan"),
    )
