"""Defines an error that the runs of a campaign share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from scipy.stats import norm

#: An error is reported if it is this many times what it is uncertain by: 5 of 10 000 by chance.
SIGNIFICANT: Final = 3.5
CHANCE: Final = 2.0 * float(norm.sf(SIGNIFICANT))
#: Errors that explain the data as well as the best one, by so much in chi^2, are named beside it.
AS_GOOD: Final = 4.0


@dataclass(frozen=True)
class SharedError:
    """One error, what the data show of it, and by how much each maximum may be wrong for it.

    ``size`` and ``u`` (k = 1) are in ``unit``. ``effect`` is relative to the maximum, by the name
    of the set; it is positive.
    """

    code: str  #: such as torque_gain, missed_tare
    sentence: str
    size: float
    u: float
    unit: str
    effect: Mapping[str, float]

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object."""
        return {
            "code": self.code,
            "sentence": self.sentence,
            "size": self.size,
            "u_k1": self.u,
            "unit": self.unit,
            "relative_effect": dict(self.effect),
        }
