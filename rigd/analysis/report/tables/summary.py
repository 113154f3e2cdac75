"""Makes the parameter table as data: one row per parameter, for a terminal, a page or a test.

A number that the data do not determine never becomes text here: if the interval is open on both
sides, or the verdict is "not identifiable", a row holds no estimate at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rigd.analysis.report.rounding import (
    DIGITS,
    interval,
    interval_places,
    number,
    percent,
    spread,
)
from rigd.analysis.report.section import ReportSection
from rigd.analysis.result import ParameterEstimate, Verdict

#: Text in place of a missing number.
NO_VALUE: Final = {Verdict.MISFIT: "does not fit", Verdict.BIASED: "biased, no value"}
UNKNOWN: Final = "not identifiable"
NO_INTERVAL: Final = "none given"


@dataclass(frozen=True)
class SummaryRow:
    """One parameter of one section, as numbers (in ``unit``) and as text ready to print.

    ``estimate`` is None if the data do not determine it; ``low`` and ``high`` are None if
    that end is open. ``comparison`` is the position of the reference to the interval; it and
    ``reference_text`` are empty if there is no reference.
    """

    section: str
    name: str
    symbol: str
    meaning: str
    unit: str
    verdict: Verdict
    derived: bool
    estimate: float | None
    low: float | None
    high: float | None
    reference: float | None
    estimate_text: str
    spread_text: str
    interval_text: str
    reference_text: str
    comparison: str
    sentence: str
    advice: str
    source: str
    flags: tuple[str, ...]

    @property
    def known(self) -> bool:
        """Whether there is an estimate to show."""
        return self.estimate is not None


#: Rows stand in this order of their verdicts: what is known leads.
KNOWN_FIRST: Final = (
    Verdict.IDENTIFIABLE,
    Verdict.WEAK,
    Verdict.BIASED,
    Verdict.UNRESOLVED,
    Verdict.CONSTANTS,
    Verdict.UNIDENTIFIABLE,
    Verdict.MISFIT,
)


def summary_rows(sections: Sequence[ReportSection]) -> tuple[SummaryRow, ...]:
    """Return the rows of all sections in their order; of each, what is known first.

    Of the same verdict, fitted parameters stand before derived ones.
    """
    return tuple(
        row
        for section in sections
        for row in sorted(_rows(section), key=lambda row: KNOWN_FIRST.index(row.verdict))
    )


def _rows(section: ReportSection) -> list[SummaryRow]:
    fitted = [_row(section, item, derived=False) for item in section.result.parameters]
    return [*fitted, *(_row(section, item, derived=True) for item in section.result.derived)]


def _row(section: ReportSection, p: ParameterEstimate, *, derived: bool) -> SummaryRow:
    known = p.quoted is not None
    low, high = (p.low, p.high) if known else (None, None)
    reference = section.reference.get(p.name)
    return SummaryRow(
        section=section.label,
        name=p.name,
        symbol=p.symbol,
        meaning=p.meaning,
        unit=p.unit,
        verdict=p.verdict,
        derived=derived,
        estimate=p.quoted,
        low=low,
        high=high,
        reference=reference,
        estimate_text=_estimate(p.estimate, low, high)
        if known
        else NO_VALUE.get(p.verdict, UNKNOWN),
        spread_text=spread(p.estimate, low, high) if known else "",
        interval_text=interval(low, high) if known else NO_INTERVAL,
        reference_text="" if reference is None else number(reference),
        comparison="" if reference is None else _comparison(p, reference),
        sentence=p.sentence,
        advice=p.advice,
        source=p.source if known else "",
        flags=tuple(flag for flag in p.flags if flag != p.verdict.value),
    )


def _estimate(estimate: float, low: float | None, high: float | None) -> str:
    """Return the estimate to the digits of its interval, marked as rough if one end is open."""
    if low is None or high is None:
        return f"≈ {number(estimate, digits=DIGITS)}"
    return number(estimate, interval_places(low, high))


def _comparison(p: ParameterEstimate, reference: float) -> str:
    if p.quoted is None:
        return "cannot be compared"
    if reference == 0.0:
        away = ""
    else:
        away = f", estimate {percent((p.estimate - reference) / abs(reference))}"
    if p.verdict is Verdict.BIASED:
        return f"interval not comparable{away}"
    above_low = p.low is None or reference >= p.low
    below_high = p.high is None or reference <= p.high
    return f"{'inside' if above_low and below_high else 'outside'} the interval{away}"
