"""What every output of a comparison shows alike: numbers with intervals, trends, reasons."""

from __future__ import annotations

import math

from rigd.analysis.compare.campaign import Campaign
from rigd.analysis.compare.comparison import LEVEL, CampaignComparison, Compared
from rigd.analysis.compare.statistics import LevelDifference, Slope
from rigd.analysis.report.opening import listed
from rigd.analysis.report.rounding import interval, number, places_for, probability, spread

METHOD = (
    "Each campaign is evaluated by itself. A difference is second less first, with the interval of "
    "95 % that both intervals make; where both rest on one constant with one stated value, its "
    "error is common and cancels. The p value is that of all campaigns being equal, for all "
    f"parameters together (Holm): below {100 * LEVEL:g} % a difference is named."
)


def named(item: Compared) -> str:
    """Return a parameter with its group."""
    return f"{item.name} ({item.group})" if item.group else item.name


def value_text(item: Compared, campaign: Campaign) -> str:
    """Return the number of a campaign with its interval, or a dash."""
    found = item.estimates[campaign.name]
    if found is None or found.value is None:
        return "–"
    around = spread(found.value, found.low, found.high)
    half = None if found.low is None or found.high is None else 0.5 * (found.high - found.low)
    places = places_for(half) if half else None
    return f"{number(found.value, places)} {around}".strip()


def difference_texts(item: Compared) -> tuple[str, str]:
    """Return the difference of two campaigns, and its interval; empty if there is none."""
    if not item.differences:
        return "", ""
    found = next(iter(item.differences.values()))
    return change_texts(item, found)


def change_texts(item: Compared, found: LevelDifference | Slope) -> tuple[str, str]:
    """Return a difference or slope and its interval, as a percentage or in the unit."""
    value, low, high = item.change(found)
    scale, unit = (100.0, " %") if item.log else (1.0, "")
    ends = [scale * end if math.isfinite(end) else None for end in (low, high)]
    bottom, top = ends
    width = 0.0 if bottom is None or top is None else top - bottom
    places = places_for(0.5 * width) if width else None
    sign = "+" if value > 0.0 else ""
    return f"{sign}{number(scale * value, places)}{unit}", f"{interval(*ends)}{unit}"


def trend_lines(comparison: CampaignComparison) -> list[str]:
    """Return the change with time of each parameter that has three dates."""
    lines = []
    for item in comparison.compared:
        if item.slope is not None:
            change, ends = change_texts(item, item.slope)
            unit = "" if item.log or item.unit == "1" else f" {item.unit}"
            chance = probability(item.slope.p_value)
            lines.append(f"{named(item)}: {change}{unit} a year, {ends}{unit} ({chance})")
    return lines


def not_compared(comparison: CampaignComparison) -> list[str]:
    """Return each reason why parameters are not compared or judged, behind their names."""
    by_reason: dict[str, list[str]] = {}
    for item in comparison.compared:
        if item.why:
            by_reason.setdefault(item.why, []).append(named(item))
    return [f"{listed(names)}: {why}" for why, names in by_reason.items()]
