"""Shows a comparison: table for the terminal, JSON, report."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rigd import __version__
from rigd.analysis.analysis import Evaluation
from rigd.analysis.compare.campaign import Campaign
from rigd.analysis.compare.comparison import LEVEL, CampaignComparison, Compared
from rigd.analysis.compare.statistics import LevelDifference, Slope
from rigd.analysis.compare.texts import (
    METHOD,
    difference_texts,
    named,
    not_compared,
    trend_lines,
    value_text,
)
from rigd.analysis.plain_data import plain_object
from rigd.analysis.report import Facts, Heading, Provenance
from rigd.analysis.report.opening import listed
from rigd.analysis.report.rounding import probability
from rigd.analysis.terminal import Column, TableRow, TerminalReport, TerminalTable


@dataclass(frozen=True)
class ComparisonEvaluation(Evaluation):
    """A comparison, with what a person reads of it."""

    comparison: CampaignComparison
    title: str = "Comparison of campaigns"

    @property
    def fits(self) -> bool:
        """Whether the model fits in all campaigns."""
        return all(item.fits for item in self.comparison.campaigns)

    @property
    def heading(self) -> Heading:
        """The campaigns, their recordings and dates."""
        first = self.comparison.campaigns[0]
        entries = [("Rig", ", ".join(first.rigs)), ("Compared", first.model)]
        entries += [(item.name, _described(item)) for item in self.comparison.campaigns]
        return Heading(entries=tuple(entries))

    @property
    def sentences(self) -> tuple[str, ...]:
        """What is found: a sentence for each parameter that differs, and one on the others."""
        tested = [item for item in self.comparison.compared if item.test is not None]
        found = [f"{named(item)} differs{_by(item)}" for item in self.comparison.different]
        same = [named(item) for item in tested if not item.differs]
        sentences = [f"{text} ({_p(item)}){_if_same(item)}." for text, item in
                     zip(found, self.comparison.different, strict=True)]  # fmt: skip
        if same:
            sentences.append(f"No difference found: {listed(same)}.")
        if any(item.differences for item in self.comparison.compared):
            return tuple(sentences) or ("No difference can be judged.",)
        return tuple(sentences) or ("No parameter could be compared.",)

    def report(self) -> str:
        """Return the report as a self-contained HTML page."""
        # Here: matplotlib takes longer to import than a comparison to compute.
        from rigd.analysis.compare.view import build_view
        from rigd.analysis.report.page import render

        facts = [
            Facts(
                item.name,
                {origin.recording: f"{origin.recorded} {_sha256(origin.recording)}".strip()
                 for origin in item.origins},
            )
            for item in self.comparison.campaigns
        ]  # fmt: skip
        facts.append(Facts("Comparison", {"rigd": __version__}))
        origin = Provenance(tuple(facts), (), self.heading)
        view = partial(build_view, self.comparison, self.sentences, self.table)
        return render("compare.html.jinja", view, origin, self.title)

    def to_json(self) -> dict[str, object]:
        """Return the comparison for ``json.dumps``; an open end and a missing number are null."""
        return {
            "title": self.title,
            "campaigns": [
                {
                    "name": item.name,
                    "model": item.model,
                    "rigs": list(item.rigs),
                    "calibrations": list(item.calibrations),
                    "recordings": [plain_object(origin) for origin in item.origins],
                    "refused": list(item.refused),
                }
                for item in self.comparison.campaigns
            ],
            "parameters": [_object(item) for item in self.comparison.compared],
            "constants": list(self.comparison.constants),
            "level": LEVEL,
        }

    def terminal_report(self) -> TerminalReport:
        """Return what differs, the table, and what is to be known of it."""
        shown: list[TerminalTable | str] = ["\n".join(self.sentences), self.table]
        trends = trend_lines(self.comparison)
        for title, lines in (
            ("trends:", trends),
            ("not compared or judged:", not_compared(self.comparison)),
            ("refused:", [f"{c.name}: {text}" for c in self.comparison.campaigns
                          for text in c.refused]),
            ("constants:", self.comparison.constants),
        ):  # fmt: skip
            if lines:
                shown.append("\n".join([title, *(f"  {line}" for line in lines)]))
        shown.append(METHOD)
        return tuple(shown)

    @property
    def table(self) -> TerminalTable:
        """Every parameter with its number in each campaign, the difference and the verdict."""
        campaigns = self.comparison.campaigns
        two = len(campaigns) == 2
        columns = [
            Column(""), Column("parameter"),
            *(Column(item.name, right=True) for item in campaigns), Column("unit"),
            *((Column("difference", right=True), Column("95 % interval", right=True))
              if two else ()),
            Column("p (Holm)", right=True), Column("verdict"),
        ]  # fmt: skip
        rows, last = [], None
        for item in self.comparison.compared:
            change, ends = difference_texts(item) if two else ("", "")
            cells = (
                item.group if item.group != last else "", item.name,
                *(value_text(item, campaign) for campaign in campaigns),
                "" if item.unit == "1" else item.unit,
                *((change, ends) if two else ()),
                "" if item.test is None else probability(item.p_holm).removeprefix("p = ")
                .removeprefix("p "),
                item.verdict,
            )  # fmt: skip
            rows.append(TableRow(cells, faint=item.test is None))
            last = item.group
        return TerminalTable(tuple(columns), tuple(rows))


def _by(item: Compared) -> str:
    if len(item.differences) != 1:
        return ""
    change, ends = difference_texts(item)
    unit = "" if item.log or item.unit == "1" else f" {item.unit}"
    return f" by {change}{unit}, {ends}{unit}"


def _if_same(item: Compared) -> str:
    if not item.rests_on:
        return ""
    return f", if the {item.rests_on} is the same in all: if not, it need not differ"


def _p(item: Compared) -> str:
    return probability(item.p_holm)


def _described(item: Campaign) -> str:
    count = len(item.origins)
    text = "1 recording" if count == 1 else f"{count} recordings"
    dates = list(dict.fromkeys(f"{date:%Y-%m-%d}" for date in item.dates))
    if dates:
        text += f", {dates[0]}" if len(dates) == 1 else f", {dates[0]} to {dates[-1]}"
    if item.calibrations:
        text += f", calibration {', '.join(item.calibrations)}"
    return text


def _object(item: Compared) -> dict[str, object]:
    def told(found: LevelDifference | Slope) -> dict[str, object]:
        value, low, high = item.change(found)
        return {
            "value": value,
            "low": low if math.isfinite(low) else None,
            "high": high if math.isfinite(high) else None,
            "p_value": found.p_value,
        }

    return {
        "group": item.group,
        "parameter": item.name,
        "unit": item.unit,
        "relative": item.log,
        "estimates": {
            name: None if found is None else {
                "value": found.value, "low": found.low, "high": found.high,
                "verdict": found.verdict, "reason": found.reason,
            }
            for name, found in item.estimates.items()
        },
        "from": item.base,
        "differences": {
            name: {**told(found), "cancelled": found.cancelled}
            for name, found in item.differences.items()
        },
        "test": None if item.test is None else plain_object(item.test),
        "p_holm": None if item.test is None else item.p_holm,
        "per_year": None if item.slope is None else told(item.slope),
        "verdict": item.verdict,
        "rests_on": item.rests_on,
        "why": item.why,
    }  # fmt: skip


def _sha256(path: str) -> str:
    """Return the digest of a recording, "" if it is not here (a result may come from elsewhere)."""
    try:
        with Path(path).open("rb") as stream:
            return f"sha256 {hashlib.file_digest(stream, 'sha256').hexdigest()}"
    except OSError:
        return ""
