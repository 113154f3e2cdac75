"""Makes the table of what each parameter's uncertainty comes from: sources by parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from rigd.analysis.report.rounding import DIGITS, number
from rigd.analysis.result import IdentificationResult

SHOWN: Final = 0.01  #: share of a variance from which its source has a row
OTHERS: Final = "all others"


@dataclass(frozen=True)
class BudgetTable:
    """Relative standard uncertainties in %, as text: (source, one for each of ``symbols``)."""

    symbols: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...]], ...]
    combined: tuple[str, ...]


def budget_table(result: IdentificationResult) -> BudgetTable | None:
    """Return the budget of the parameters that have a number, the largest source first.

    None, if the analysis makes none.
    """
    every = (*result.parameters, *result.derived)
    columns = [item for item in every if item.name in result.budget and item.quoted is not None]
    if not columns:
        return None
    variances = [{k: u**2 for k, u in result.budget[item.name].items()} for item in columns]
    sums = [sum(column.values()) for column in variances]

    def share(source: str) -> float:
        pairs = zip(variances, sums, strict=True)
        return max(column.get(source, 0.0) / total if total else 0.0 for column, total in pairs)

    sources = sorted({source for column in variances for source in column}, key=share, reverse=True)
    named = [source for source in sources if share(source) >= SHOWN]
    rows = [
        (name, tuple(_percent(column.get(name, 0.0)) for column in variances)) for name in named
    ]
    if len(named) < len(sources):
        left = [sum(v for name, v in column.items() if name not in named) for column in variances]
        rows.append((OTHERS, tuple(_percent(value) for value in left)))
    return BudgetTable(
        tuple(item.symbol for item in columns), tuple(rows), tuple(_percent(s) for s in sums)
    )


def _percent(variance: float) -> str:
    percent = 100.0 * math.sqrt(variance)
    return number(percent, digits=DIGITS) if percent >= 5e-4 else "–"
