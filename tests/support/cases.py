"""How many cases of a study the suite plays: some; `benchmarks/every_case.py` plays all."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Final, TypeVar

Case = TypeVar("Case")

#: In the environment of a suite that plays all cases.
EVERY_CASE: Final = "RIGD_TESTS_EVERY_CASE"


def some(cases: Sequence[Case], one_in: int, begin: int = 0) -> Sequence[Case]:
    """Return one case in ``one_in`` from that at ``begin`` on; all if they are wanted."""
    return cases if EVERY_CASE in os.environ else cases[begin::one_in]
