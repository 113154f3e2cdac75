"""Makes the table of compared models as data: one row per model, for a terminal or a page."""

from __future__ import annotations

from dataclasses import dataclass

from rigd.analysis.report.rounding import number, percent, places_for
from rigd.analysis.result import ModelComparison, ModelScore

#: The heads of the columns of :class:`ModelRow` after its name.
HEADS = ("parameters", "ΔBIC", "error on trials left out", "")


@dataclass(frozen=True)
class ModelRow:
    """One model, as text."""

    name: str
    title: str
    parameters: str
    delta_bic: str
    error: str
    notes: str
    fits: bool

    @property
    def cells(self) -> tuple[str, ...]:
        """Return what stands under the name and :data:`HEADS`."""
        return (self.name, self.parameters, self.delta_bic, self.error, self.notes)


def model_rows(comparison: ModelComparison) -> tuple[ModelRow, ...]:
    """Return the rows in the order of the scores."""
    fitting = [score.cv_error for score in comparison.scores if score.fits]
    least = min(fitting or [score.cv_error for score in comparison.scores])
    return tuple(_row(score, least) for score in comparison.scores)


def _row(score: ModelScore, least: float) -> ModelRow:
    places = places_for(least)
    notes = [] if score.fits else ["does not fit"]
    if score.on_bound:
        notes.append(f"on a bound: {', '.join(score.on_bound)}")
    more = f" ({percent(score.cv_error / least - 1.0)})" if score.cv_error > least else ""
    return ModelRow(
        name=score.name,
        title=score.title,
        parameters=str(score.parameters),
        delta_bic=number(score.delta_bic, places=1),
        error=f"{number(score.cv_error, None if places is None else places + 1)}{more}",
        notes="; ".join(notes),
        fits=score.fits,
    )
