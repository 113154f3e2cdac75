"""Validates a saved model on recordings; the result has a report, JSON and terminal tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rigd.analysis.analysis import Evaluation, Validates
from rigd.analysis.evaluation import open_sweeps
from rigd.analysis.plan import analysis_of
from rigd.analysis.provenance import provenance
from rigd.analysis.recordings.corrections import Corrections
from rigd.analysis.recordings.source import Correction
from rigd.analysis.report import Heading, Opening, Provenance
from rigd.analysis.report.opening import joined
from rigd.analysis.validation.result import ModelOutcome, Validation
from rigd.analysis.validation.saved_models import read_models
from rigd.analysis.validation.tables import overview, published_table, summary
from rigd.config.registry import ANALYSES, FRICTION_LAWS, installed
from rigd.model.errors import ConfigError, DataError

if TYPE_CHECKING:
    from rigd.analysis.terminal import TerminalReport


@dataclass(frozen=True)
class ValidationEvaluation(Evaluation):
    """How recordings agree with a saved model, and the origin of both."""

    title: str
    model_path: Path
    result: Validation
    recordings: tuple[Path, ...]
    provenance: Provenance

    @property
    def fits(self) -> bool:
        """Whether no group rejects its model."""
        return not self._has(ModelOutcome.REJECTED)

    @property
    def telling(self) -> bool:
        """Whether every group could separate its model from a wrong one."""
        return not self._has(ModelOutcome.UNTESTED)

    @property
    def opening(self) -> Opening:
        """Which models the recordings confirm, and which they do not."""
        usable, unusable = [], []
        for group in self.result.groups:
            name = f"{group.model} on {group.label}"
            if group.outcome in (ModelOutcome.CONFIRMED, ModelOutcome.CORRECTED):
                trials = "1 trial" if len(group.trials) == 1 else f"{len(group.trials)} trials"
                usable.append(f"{name}, {group.outcome.value} by {trials}")
            else:
                unusable.append(f"{name}, {group.outcome.value}: {group.sentence.rstrip('.')}")
        beyond = "what lies beyond the speeds and slips of these trials"
        return Opening(joined(usable, "no model"), joined(unusable, beyond))

    @property
    def heading(self) -> Heading:
        """Origin of the data."""
        return self.provenance.heading

    def report(self) -> str:
        """Return the report as a self-contained HTML page."""
        # Here, so that a command that only names this module does not wait for matplotlib.
        from rigd.analysis.report.page import render
        from rigd.analysis.validation.view import build_view

        return render(
            "validation.html.jinja",
            lambda: build_view(self.result),
            self.provenance,
            self.title,
            opening=self.opening,
        )

    def to_json(self) -> dict[str, object]:
        """Return the results as an object for ``json.dumps``."""
        return {
            "title": self.title,
            "model_file": str(self.model_path),
            "recordings": [str(path) for path in self.recordings],
            **self.result.to_json(),
        }

    def terminal_report(self) -> TerminalReport:
        """Return the verdict on each group, then the tables."""
        shown: list[str] = []
        for group in self.result.groups:
            lines = [
                f"{group.outcome.value}: {group.model} on {group.label}",
                f"  {group.sentence}",
            ]
            lines += [f"  {finding}" for finding in group.findings]
            lines += [f"  {item.label} was left out: {item.reason}" for item in group.left_out]
            shown.append("\n".join(lines))
        tables = [overview(self.result), published_table(self.result)]
        return (*shown, summary(self.result), *(table for table in tables if table is not None))

    def _has(self, outcome: ModelOutcome) -> bool:
        return any(group.outcome is outcome for group in self.result.groups)


def validate(
    model: Path,
    paths: Sequence[Path],
    *,
    group: str = "",
    notify: Callable[[str], None] = lambda _: None,
    passed_over: Callable[[str], None] = lambda _: None,
    corrections: Corrections | None = None,
    changed: Callable[[Correction], None] = lambda _: None,
) -> ValidationEvaluation:
    """Try the model file ``model`` on the recordings at ``paths``.

    ``group`` names the model to take, of several in the file. The others are as for
    :func:`rigd.analysis.evaluation.evaluate`.

    Raises:
        RecordingError: a recording cannot be read.
        ConfigError: the model cannot be used, its analysis cannot validate, or a correction is
            wrong.
        DataError: a recording is of another model, is there twice, or cannot answer.
    """
    models = read_models(model)
    names = list(dict.fromkeys(item.model for item in models))
    if len(names) > 1:
        raise ConfigError(f"{model} has models of several analyses: {', '.join(names)}")
    sweeps = open_sweeps(paths, passed_over, corrections, changed)
    laws = set(installed(FRICTION_LAWS)) - set(installed(ANALYSES))  # one name may be both
    if sweeps[0].plan.model != names[0] and names[0] in laws:
        raise models[0].error(
            f"these are parameters of the friction law {names[0]}: `rigd validate` simulates the "
            f"rig with the law {sweeps[0].plan.model} alone",
            ("model",),
            hint="identify again without `--law`, and give that model; `rigd identify --compare` "
            "shows how well each law fits the recordings",
        )
    analysis = analysis_of(sweeps[0].plan)
    if sweeps[0].plan.model != names[0]:
        takes = "model" in analysis.options
        raise DataError(
            f"{sweeps[0].path} identifies {sweeps[0].plan.model}, {model} is a model of {names[0]}",
            hint="give recordings of the rig that the model is of"
            + ("; `rigd identify FILE --model MODEL` takes the model as known" if takes else ""),
        )
    optional = analysis.needs.optional_signals
    judge = analysis()
    if not isinstance(judge, Validates):
        raise ConfigError(
            f"models of {names[0]} cannot be validated: this analysis does not simulate its rig",
            hint="`rigd identify` on both recordings compares what they give",
        )
    result = judge.validate(models, [sweep.without(optional) for sweep in sweeps], group, notify)
    used = [
        sum(trial.recording == str(sweep.path) for item in result.groups for trial in item.trials)
        for sweep in sweeps
    ]
    facts = {"model": str(model.name), "method": result.method}
    return ValidationEvaluation(
        result.title, model, result, tuple(sweep.path for sweep in sweeps),
        provenance(sweeps, used, facts),
    )  # fmt: skip
