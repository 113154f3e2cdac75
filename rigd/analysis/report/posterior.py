"""Makes the table of credible intervals as data: one row per parameter, for terminal and page."""

from __future__ import annotations

from dataclasses import dataclass

from rigd.analysis.report.rounding import count, interval, interval_places, number
from rigd.analysis.result import IdentificationResult

#: The heads of the columns of :class:`CredibleRow` after the name, but the unit.
HEADS = ("median", "95 % credible", "95 % interval", "unit", "R-hat", "effective draws (tail)")


@dataclass(frozen=True)
class CredibleRow:
    """One parameter, as text; ``cells`` stand under :data:`HEADS`."""

    name: str
    symbol: str
    cells: tuple[str, ...]
    sentence: str
    known: bool


def credible_rows(result: IdentificationResult) -> tuple[CredibleRow, ...]:
    """Return the rows of ``result``'s posterior, beside the intervals of its table."""
    if result.posterior is None:
        return ()
    rows = []
    for item in result.posterior.parameters:
        beside = result.parameter(item.name)
        known = item.estimate is not None
        places = interval_places(item.low, item.high)
        rows.append(
            CredibleRow(
                item.name,
                item.symbol,
                (
                    "–" if item.estimate is None else number(item.estimate, places),
                    interval(item.low, item.high) if known else "–",
                    interval(beside.low, beside.high) if beside.quoted is not None else "–",
                    "" if item.unit == "1" else item.unit,
                    number(item.r_hat, 3),
                    f"{count(item.bulk)} ({count(item.tail)})",
                ),
                item.sentence,
                known,
            )
        )
    return tuple(rows)


def how_sampled(result: IdentificationResult) -> str:
    """Return how the posterior was sampled, in a sentence; empty if there is none."""
    found = result.posterior
    if found is None:
        return ""
    chains, draws = found.draws.shape[:2]
    return (
        f"{chains} independent chains, {count(chains * draws)} draws kept, "
        f"{count(found.evaluations)} simulations of all trials; "
        f"-2 ln L divided by {number(found.tempering, 2)}, as the residuals are not quite white."
    )
