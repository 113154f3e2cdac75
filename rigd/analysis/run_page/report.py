"""Makes the report page of a run from one recording, with any content and any end."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd import __version__
from rigd.analysis.heading import heading
from rigd.analysis.provenance import attachments_of, facts_of
from rigd.analysis.report import Facts, Provenance
from rigd.model.errors import ConfigError, DataError
from rigd.record import Recording, RunInfo

_RANGE: Final = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?")


@dataclass(frozen=True)
class Selection:
    """Numbers of the trials to draw one by one; None selects a few, early-ended trials first."""

    numbers: frozenset[int] | None = None

    def check(self, info: RunInfo) -> None:
        """Check that the run has the trials.

        Raises:
            DataError: it has not.
        """
        known = {trial.number for trial in info.trials}
        unknown = sorted((self.numbers or frozenset()) - known)
        if unknown:
            there = f"it has {min(known)} to {max(known)}" if known else "it has none"
            raise DataError(f"{info.path} has no trial {unknown[0]}", hint=there)


def parse_selection(text: str) -> Selection:
    """Return the trials of a text such as ``1,4,7-9``.

    Raises:
        ConfigError: it is no such text.
    """
    numbers: set[int] = set()
    for part in text.split(","):
        match = _RANGE.fullmatch(part.strip())
        first = int(match[1]) if match else 1
        last = int(match[2] or match[1]) if match else 0
        if not 0 <= last - first < 10_000:
            raise ConfigError(f"{text!r} names no trials", hint="write --trials 1,4,7-9")
        numbers.update(range(first, last + 1))
    return Selection(frozenset(numbers))


def run_report(
    path: Path,
    selection: Selection | None = None,
    passed_over: Callable[[str], object] = lambda _: None,
) -> str:
    """Return the report of the recording at ``path`` as a self-contained HTML page.

    A recording that is torn or damaged gives a page of what can be read, with a notice;
    ``passed_over`` is called with each damage and loss that is known, as a sentence. Memory does
    not grow with the recording; a campaign of 200 trials takes some seconds.

    Raises:
        RecordingError: nothing of the file can be read.
        DataError: a trial was asked for that the recording does not have.
    """
    # Every byte is checked: a page that looks whole is not made of a file that is not.
    recording = Recording.open(path, partial=True)
    info = recording.info
    chosen = selection or Selection()
    chosen.check(info)
    for loss in info.losses:
        passed_over(loss)
    # Here, so that a command that only names this module does not wait for matplotlib.
    from rigd.analysis.report.page import render
    from rigd.analysis.run_page.view import build_view

    return render(
        "run.html.jinja",
        lambda: build_view(recording, info, chosen.numbers),
        _provenance(recording, info),
        info.metadata.get("run", {}).get("title") or info.procedure or path.name,
    )


def _provenance(recording: Recording, info: RunInfo) -> Provenance:
    facts = (facts_of(info, {}), Facts("Report", {"rigd": __version__}))
    return Provenance(facts, attachments_of([recording]), heading([info]))
