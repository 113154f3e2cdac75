"""How many cases of a study the suite plays: some; `benchmarks/every_case.py` plays all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Final, TypeVar

Case = TypeVar("Case")

#: In the environment of a suite that plays all cases.
EVERY_CASE: Final = "RIGD_TESTS_EVERY_CASE"
#: Rules of `check_analysis` for an analysis whose evaluation takes long: they need few of them.
FEW_EVALUATIONS: Final = (
    "is checked without its numerics",
    "recovers the truth",
    "does not depend on the rate",
    "does not depend on the order of trials",
    "uses the constants of the rig",
    "gives the same bytes for the same input",
    "refuses what it cannot read",
)


def some(cases: Sequence[Case], one_in: int, begin: int = 0) -> Sequence[Case]:
    """Return one case in ``one_in`` from that at ``begin`` on; all if they are wanted."""
    return cases if EVERY_CASE in os.environ else cases[begin::one_in]
