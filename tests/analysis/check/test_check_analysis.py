"""`check_analysis` finds what an analysis promises and does not keep: one broken one per rule."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from rigd.analysis import Analysis, DataError, Evaluation, Needs, Options
from rigd.analysis.check import Case, SimulatedTrial, check_analysis, examine_analysis, write_case
from rigd.analysis.recordings.source import RecordedSweep, open_sweep
from rigd.analysis.terminal import Column, TableRow, TerminalReport, TerminalTable
from rigd.sdk.check import NonConforming

TRUTH = 3.0
Interval = tuple[float, float] | None


class MeanEvaluation(Evaluation):
    """The mean of a signal and its noise, each with an interval."""

    title = "mean of x"

    def __init__(self, found: Mapping[str, Interval]) -> None:
        self.found = found

    def report(self) -> str:
        return f"<html>{self.title}: {dict(self.found)}</html>"

    def to_json(self) -> dict[str, object]:
        return dict(self.found)

    def terminal_report(self) -> TerminalReport:
        rows = tuple(TableRow((name, str(interval))) for name, interval in self.found.items())
        return (TerminalTable((Column("name"), Column("interval")), rows),)


class Mean(Analysis):
    """The mean of a signal beyond an offset, and how much it is scattered."""

    needs = Needs(signals={"x": "m"}, constants=("offset",))

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        trials = [(sweep, trial) for sweep in sweeps for trial in sweep.trials]
        values = [
            sweep.signals(trial)[1]["x"] - sweep.constant(trial, "offset")
            for sweep, trial in trials
        ]
        if not values:
            raise DataError("no trial came to its end", hint="run it again")
        if not np.all(np.isfinite(np.concatenate(values))):
            raise DataError("samples are no numbers", hint="look at them")
        return MeanEvaluation(self.found(np.concatenate(values)))

    def found(self, values: np.ndarray) -> dict[str, Interval]:
        middle, sd = float(values.mean()), float(values.std())
        far = 2.0 * sd / np.sqrt(1 + np.count_nonzero(np.diff(values)))  # held samples count once
        scatter = (0.9 * sd, 1.1 * sd) if sd else None
        return {"mean": (middle - far, middle + far), "scatter": scatter}


class WithoutWords(Mean):
    needs = Needs(
        signals={"x": "parsec per week"}, constants=("offset",), calibrated=("scale",),
        constant_units={"offset": "ells", "ofset": "m"},
    )  # fmt: skip


WithoutWords.__doc__ = None


class Wrong(Mean):
    """Forgets the offset."""

    def found(self, values: np.ndarray) -> dict[str, Interval]:
        return super().found(values + 1.0)


class Vague(Mean):
    """Returns an interval without bounds."""

    def found(self, values: np.ndarray) -> dict[str, Interval]:
        return {**super().found(values), "mean": (-100.0, 106.0)}


class Missing(Mean):
    """Finds no mean."""

    def found(self, values: np.ndarray) -> dict[str, Interval]:
        return {**super().found(values), "mean": None}


class Boastful(Mean):
    """Gives a number for what the data cannot hold."""

    def found(self, values: np.ndarray) -> dict[str, Interval]:
        return {**super().found(values), "skewness": (0.1, 0.2)}


class Fickle(Mean):
    """Draws at random without a seed."""

    draws = itertools.count()

    def found(self, values: np.ndarray) -> dict[str, Interval]:
        shift = 1e-6 * next(self.draws)
        low, high = super().found(values)["mean"] or (0.0, 0.0)
        return {"mean": (low + shift, high + shift)}


class Greedy(Mean):
    """Changes what it is given."""

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        found = super().evaluate(sweeps, options, notify)
        sweeps[0].plan.constants["offset"] = 6.0  # type: ignore[index]
        return found


class Hasty(Mean):
    """Takes what the first trial shows for all."""

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        (sweep,) = sweeps
        if not sweep.trials:
            raise DataError("no trial came to its end", hint="run it again")
        return MeanEvaluation(self.found(sweep.signals(sweep.trials[0])[1]["x"] - 5.0))


class FirstOffset(Mean):
    """Takes the offset of the first trial for all."""

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        first = sweeps[0]
        if first.trials:
            offset = first.constant(first.trials[0], "offset")
            shared = replace(first.plan, constants={"offset": offset})
            sweeps = [replace(sweep, plan=shared) for sweep in sweeps]
        return super().evaluate(sweeps, options, notify)


class WithoutFirst(Mean):
    """Leaves the first trial out."""

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        info = sweeps[0].info
        rest = replace(sweeps[0], info=replace(info, trials=info.trials[1:]))
        return super().evaluate([rest, *sweeps[1:]], options, notify)


class ByNumber(Mean):
    """Keeps one trial of each number."""

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        last = {trial.number: sweep for sweep in sweeps for trial in sweep.trials}
        kept = [
            replace(
                sweep,
                info=replace(
                    sweep.info,
                    trials=tuple(each for each in sweep.trials if last[each.number] is sweep),
                ),
            )
            for sweep in sweeps
        ]
        return super().evaluate(kept, options, notify)


class Counting(Mean):
    """Counts held samples as measurements."""

    def found(self, values: np.ndarray) -> dict[str, Interval]:
        middle, far = float(values.mean()), 2.0 * float(values.std()) / np.sqrt(len(values))
        return {**super().found(values), "mean": (middle - far, middle + far)}


class Filling(Mean):
    """Takes samples that are no numbers for zero, if there are others."""

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        values = [
            sweep.signals(trial)[1]["x"] - sweep.constant(trial, "offset")
            for sweep in sweeps
            for trial in sweep.trials
        ]
        if not values or not np.any(np.isfinite(np.concatenate(values))):
            raise DataError("samples are no numbers", hint="look at them")
        return MeanEvaluation(self.found(np.nan_to_num(np.concatenate(values))))


class Trusting(Mean):
    """Accepts any data."""

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        return MeanEvaluation({"mean": (2.9, 3.1), "scatter": None})


class Crashing(Mean):
    """Divides by what is not there."""

    def found(self, values: np.ndarray) -> dict[str, Interval]:
        return super().found(values)

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        if not sweeps[0].trials:
            raise IndexError("list index out of range")
        return super().evaluate(sweeps, options, notify)


class Curt(Mean):
    """Refuses without a sentence."""

    def evaluate(
        self, sweeps: Sequence[RecordedSweep], options: Options, notify: Callable[[str], None]
    ) -> Evaluation:
        if not sweeps[0].trials:
            raise DataError("no")
        return super().evaluate(sweeps, options, notify)


def read(evaluation: Evaluation) -> Mapping[str, Interval]:
    assert isinstance(evaluation, MeanEvaluation)
    return evaluation.found


def case() -> Case:
    noise = np.random.default_rng(1).standard_normal((2, 400))
    trials = [
        SimulatedTrial(np.arange(400) / 1000.0, {"x": TRUTH + 5.0 + 0.1 * item}) for item in noise
    ]
    return Case(trials, {"offset": 5.0}, {"mean": TRUTH, "scatter": 0.1}, unknown=("skewness",))


def test_a_good_analysis_keeps_every_rule(tmp_path: Path) -> None:
    report = check_analysis(Mean, [case(), case()], tmp_path, read=read)
    assert not report.findings
    of_cases = [rule for rule in report.checked if "case" in rule]
    assert len(of_cases) == 2 * 9


def test_analysis_that_is_slow_to_import_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "slow_analysis.py").write_text(
        "import scipy.optimize\n"
        "from rigd.analysis import Analysis, Needs\n"
        "class Slow(Analysis):\n"
        '    """Waits for numerics."""\n'
        "    needs = Needs({'x': 'm'})\n"
        "    def evaluate(self, sweeps, options, notify): ...\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    (module,) = (file.stem for file in tmp_path.glob("*.py"))
    slow = import_module(module).Slow
    (finding,) = examine_analysis(slow, [], tmp_path, read=read).findings
    assert "its module imports scipy" in finding.problem


@pytest.mark.parametrize(
    ("broken", "rule", "words"),
    [
        (WithoutWords, "declares what it needs", "parsec"),
        (WithoutWords, "declares what it needs", "constant offset: unknown unit 'ells'"),
        (WithoutWords, "declares what it needs", "no constant 'ofset' that has a unit"),
        (WithoutWords, "declares what it needs", "calibrated value scale"),
        (WithoutWords, "declares what it needs", "no docstring"),
        (Wrong, "recovers the truth (case 1)", "the truth is 3"),
        (Vague, "recovers the truth (case 1)", "only"),
        (Missing, "recovers the truth (case 1)", "mean is not found"),
        (Boastful, "recovers the truth (case 1)", "which these data cannot hold"),
        (Fickle, "gives the same bytes for the same input (case 1)", "two JSON objects"),
        (Greedy, "gives the same bytes for the same input (case 1)", "two JSON objects"),
        (FirstOffset, "uses each trial (case 1)", "count at one place"),
        (WithoutFirst, "uses each trial (case 1)", "trial 1 counts by being there"),
        (ByNumber, "uses each trial (case 1)", "in two recordings it finds"),
        (Counting, "counts what was measured (case 1)", "held for 3 rows"),
        (Filling, "counts what was measured (case 1)", "samples that are no numbers mean is"),
        (Trusting, "refuses what it cannot read (case 1)", "no numbers gives mean"),
        (Crashing, "refuses what it cannot read (case 1)", "raises IndexError"),
        (Curt, "refuses what it cannot read (case 1)", "refused with 'no'"),
    ],
)
def test_each_broken_promise_is_found(
    broken: type[Analysis], rule: str, words: str, tmp_path: Path
) -> None:
    report = examine_analysis(broken, [case()], tmp_path, read=read)
    assert any(finding.rule == rule and words in finding.problem for finding in report.findings), (
        str(report)
    )


@pytest.mark.parametrize(("analysis", "found"), [(Mean, False), (Hasty, True)])
def test_what_depends_on_trial_order_is_found(
    analysis: type[Analysis], found: bool, tmp_path: Path
) -> None:
    trials = case().trials
    apart = [
        replace(trials[0], signals={"x": trials[0].signals["x"] + shift}) for shift in (0.0, 1, -1)
    ]
    of_three = Case(apart, {"offset": 5.0}, {"mean": TRUTH})
    rule = "does not depend on the order of trials"
    report = examine_analysis(
        analysis, [of_three], tmp_path, read=read, only=["recovers the truth", rule]
    )
    assert [finding.rule for finding in report.findings] == [f"{rule} (case 1)"] * found


def drawn(random: np.random.Generator) -> Case:
    """A case of another truth, whose trials have offsets of their own."""
    truth, sd = random.uniform(1.0, 9.0), random.uniform(0.1, 0.5)
    trials = []
    for offset in random.uniform(-5.0, 5.0, 3):
        x = truth + offset + sd * random.standard_normal(random.integers(200, 400))
        trials.append(SimulatedTrial(np.arange(len(x)) / 1000.0, {"x": x}, {"offset": offset}))
    return Case(trials, {"offset": "offset"}, {"mean": truth})


class OneTruth(Mean):
    """Knows the cases of its author."""

    def found(self, values: np.ndarray) -> dict[str, Interval]:
        return {**super().found(values), "mean": (2.9, 3.1)}


class Narrow(Mean):
    """Gives intervals of a fifth of the width."""

    def found(self, values: np.ndarray) -> dict[str, Interval]:
        low, high = super().found(values)["mean"] or (0.0, 0.0)
        return {"mean": (0.6 * low + 0.4 * high, 0.4 * low + 0.6 * high)}


@pytest.mark.parametrize(("analysis", "found"), [(Mean, False), (OneTruth, True), (Narrow, True)])
def test_random_truths_are_asked_for(analysis: type[Analysis], found: bool, tmp_path: Path) -> None:
    rule = "recovers what is drawn"
    report = examine_analysis(analysis, [], tmp_path, read=read, only=[rule], drawn=drawn)
    assert {finding.rule for finding in report.findings} == {rule} if found else not report.findings


def test_broken_promise_is_raised_with_its_report(tmp_path: Path) -> None:
    with pytest.raises(NonConforming, match="the truth is 3"):
        check_analysis(Wrong, [case()], tmp_path, read=read)


def test_case_is_recorded_unchanged(tmp_path: Path) -> None:
    whole = case()
    sweep = open_sweep(write_case(tmp_path / "a.mcap", Mean, whole))
    for trial, simulated in zip(sweep.trials, whole.trials, strict=True):
        t_s, signals = sweep.signals(trial)
        assert np.array_equal(signals["x"], simulated.signals["x"])
        assert t_s == pytest.approx(simulated.t_s)
    unequal = [whole.trials[0], replace(whole.trials[1], signals={})]
    with pytest.raises(ValueError, match="the same signals"):
        write_case(tmp_path / "b.mcap", Mean, replace(whole, trials=unequal))
