"""Builds the content of the report of a comparison: table, figures.

Importing this module imports matplotlib.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rigd.analysis.compare import plots, texts
from rigd.analysis.compare.comparison import CampaignComparison
from rigd.analysis.report.svg import Drawing, draw
from rigd.analysis.terminal import TerminalTable

#: Of a figure with arrows.
OPEN: Final = " Arrow: the interval has no end on this side."


@dataclass(frozen=True)
class ComparisonView:
    """The whole report."""

    sentences: tuple[str, ...]
    table: TerminalTable
    lists: tuple[tuple[str, Sequence[str]], ...]
    changes: tuple[Drawing, ...]
    curves: tuple[Drawing, ...]
    trends: tuple[Drawing, ...]
    method: str


def build_view(
    found: CampaignComparison, sentences: tuple[str, ...], table: TerminalTable
) -> ComparisonView:
    """Return the view of a comparison, for :func:`rigd.analysis.report.page.render`."""
    lists = (
        ("Trends", texts.trend_lines(found)),
        ("Not compared", texts.not_compared(found)),
        ("Refused", [f"{item.name}: {why}" for item in found.campaigns for why in item.refused]),
        ("Constants", found.constants),
    )
    return ComparisonView(
        sentences,
        table,
        tuple((title, lines) for title, lines in lists if lines),
        _changes(found),
        _curves(found),
        _trends(found),
        texts.METHOD,
    )


def _changes(found: CampaignComparison) -> tuple[Drawing, ...]:
    rows = [
        (texts.named(item), item.change(difference), item.differs)
        for item in found.compared
        for difference in item.differences.values()
        if item.log
    ]
    if len(found.campaigns) != 2 or not rows:
        return ()
    alt = "Relative difference of each parameter with its 95 % interval."
    is_open = any(not math.isfinite(end) for _, change, _ in rows for end in change)
    caption = f"{alt} Filled: it differs.{OPEN if is_open else ''}"
    return (draw(plots.changes(rows), "changes", alt, caption),)


def _curves(found: CampaignComparison) -> tuple[Drawing, ...]:
    drawings = []
    groups = dict.fromkeys(group for item in found.campaigns for group in item.curves)
    for index, group in enumerate(groups):
        curves = {c.name: c.curves[group] for c in found.campaigns if group in c.curves}
        if len(curves) > 1:
            alt = f"{group}: the fitted curves of {', '.join(curves)} over one another."
            caption = (
                f"{alt} Bands: 95 %, each with the uncertainty of constants that all share, which "
                "the differences above do not have."
            )
            drawings.append(draw(plots.curves(curves), f"curves-{index}", alt, caption))
    return tuple(drawings)


def _trends(found: CampaignComparison) -> tuple[Drawing, ...]:
    if len(found.campaigns) < 3 or not all(item.dates for item in found.campaigns):
        return ()
    drawings = []
    for index, item in enumerate(found.compared):
        if item.test is None:
            continue
        alt = f"{texts.named(item)} over the time of the recordings."
        figure = plots.trend(item, found.campaigns)
        ends = [e for e in item.estimates.values() if e is not None and e.value is not None]
        is_open = any(None in (e.low, e.high) for e in ends)
        caption = f"{alt} Dashed: another calibration begins.{OPEN if is_open else ''}"
        drawings.append(draw(figure, f"trend-{index}", alt, caption))
    return tuple(drawings)
