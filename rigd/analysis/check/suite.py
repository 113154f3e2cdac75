"""Checks the rules that every analysis must keep, on cases that its author simulated."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rigd.analysis.analysis import Analysis, Evaluation, Options
from rigd.analysis.calibration.evaluation import CalibrationEvaluation
from rigd.analysis.check.case import Case, SimulatedTrial, write_case
from rigd.analysis.check.comparison import (
    REPEATED,
    SPOILT_WIDTH,
    Found,
    Interval,
    altered_constants,
    constants_count_anywhere,
    counts_by_its_data,
    held,
    held_samples,
    repeats,
    rotated,
    spoilt_samples,
    watched_fits,
    whole_in_parts,
    wider,
    wrong_derivatives,
)
from rigd.analysis.evaluation import evaluate_sweeps
from rigd.analysis.parameters import ParameterEvaluation
from rigd.analysis.plan import check_plan
from rigd.analysis.recordings.source import RecordedSweep, open_sweep
from rigd.analysis.terminal import TerminalTable
from rigd.model.errors import RigdError
from rigd.model.units import parse_unit
from rigd.sdk.analysis import ANY_UNIT, choices
from rigd.sdk.check import Finding, NonConforming, Report
from rigd.sdk.check.subject import described

Read = Callable[[Evaluation], Found]
#: Simulates a case from a truth at random.
Drawn = Callable[[np.random.Generator], Case]

#: A truth may lie so many half widths from the middle of its interval: one in 20 lies beyond 1,
#: one in 10 000 beyond 2.
_SURPRISE: Final = 2.0
#: Half the interval over the truth: a wider one recovers nothing.
_WIDEST: Final = 1.0
#: What checking a plan must not wait for.
_HEAVY: Final = ("matplotlib", "numba", "scipy")
_DECLARED: Final = "declares what it needs"
_DRAWN: Final = "recovers what is drawn"
#: Cases that are drawn, and the largest rms of their errors in half widths: with eight of normal
#: errors, one analysis in 10 000 has more.
_DRAWS: Final = 8
_RMS: Final = 1.0
_LIGHT: Final = "is checked without its numerics"
#: When a report was made is all that may differ between two of them.
_MADE: Final = re.compile(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC")


def check_analysis(
    analysis: type[Analysis],
    cases: Sequence[Case],
    folder: Path,
    *,
    read: Read | None = None,
    only: Collection[str] = (),
    drawn: Drawn | None = None,
    seed: int = 1,
) -> Report:
    """Check ``analysis`` on ``cases``; recordings are written to ``folder``, which is empty.

    ``read`` returns the intervals in an evaluation by name; :func:`intervals_of` unless given.
    ``only`` are names of the rules to apply, without their case; by default all. ``drawn``
    simulates a case at random, with another truth, and constants, rates and lengths that differ
    from trial to trial; what is drawn is drawn from ``seed``.

    Raises:
        NonConforming: a rule is broken; its report names each with what is asked for.
    """
    report = examine_analysis(analysis, cases, folder, read=read, only=only, drawn=drawn, seed=seed)
    if report.findings:
        raise NonConforming(report)
    return report


def examine_analysis(
    analysis: type[Analysis],
    cases: Sequence[Case],
    folder: Path,
    *,
    read: Read | None = None,
    only: Collection[str] = (),
    drawn: Drawn | None = None,
    seed: int = 1,
) -> Report:
    """Return what :func:`check_analysis` finds, without raising."""
    bench = _Bench(analysis, folder, read or intervals_of)
    wrong = [Finding(_DECLARED, *item) for item in bench.declared()]
    rules: list[tuple[str, Callable[[], Iterator[tuple[str, str]]]]] = [(_LIGHT, bench.light)]
    if drawn is not None:
        rules.append((_DRAWN, partial(bench.random_truths, drawn, seed)))
    for index, case in enumerate(cases, start=1):
        rules += [
            (f"{rule} (case {index})", partial(check, case))
            for rule, check in (
                ("recovers the truth", bench.truth),
                ("does not depend on the rate", bench.slower),
                ("does not depend on the order of trials", bench.permuted),
                ("uses the constants of the rig", bench.constants),
                ("gives the same bytes for the same input", bench.repeatable),
                ("refuses what it cannot read", bench.refusals),
                ("uses each trial", bench.each_trial),
                ("counts what was measured", bench.measured),
                ("fits as it is asked to", bench.fits),
            )
        ]
    if wrong:  # no recording can be made for it
        skipped = {rule: "right declarations" for rule, _ in rules}
        return Report(analysis.__name__, tuple(wrong), (_DECLARED,), skipped)
    skipped = {_LIGHT: "a module that another process can import"} if bench.heavy is None else {}
    if drawn is None and not only:
        skipped[_DRAWN] = "cases that `drawn` simulates at random"
    played = [
        (rule, check)
        for rule, check in rules
        if rule not in skipped and (not only or rule.partition(" (")[0] in only)
    ]
    findings = [Finding(rule, *item) for rule, check in played for item in _found_by(check)]
    checked = (_DECLARED, *(rule for rule, _ in played))
    return Report(analysis.__name__, tuple(findings), checked, skipped, seed if drawn else None)


def _found_by(check: Callable[[], Iterator[tuple[str, str]]]) -> list[tuple[str, str]]:
    found: list[tuple[str, str]] = []
    try:
        found += check()
    except Exception as error:  # noqa: BLE001  # what the analysis raises is what is reported
        found.append(
            (f"it raises {described(error)}", "raise DataError with a sentence and a hint")
        )
    return found


def intervals_of(evaluation: Evaluation) -> Mapping[str, Interval]:
    """Return the intervals in an evaluation by fitting, or of a calibration, by name.

    Raises:
        TypeError: it is another kind of evaluation: give ``read``.
    """
    found: dict[str, Interval] = {}
    if isinstance(evaluation, ParameterEvaluation):
        for section in evaluation.sections:
            for item in (*section.result.parameters, *section.result.derived):
                known = item.quoted is not None and item.identifiable
                ends = (item.low, item.high)
                found[item.name] = (
                    (ends[0], ends[1])
                    if known and ends[0] is not None and ends[1] is not None
                    else None
                )
        return found
    if isinstance(evaluation, CalibrationEvaluation):
        for name, value in evaluation.result.measured.items():
            found[name] = (value.value - 2.0 * value.u, value.value + 2.0 * value.u)
        return found
    raise TypeError(f"give `read`: {type(evaluation).__name__} has no intervals of its own")


class _Bench:
    """Writes recordings of a case, whole and damaged, and evaluates them."""

    def __init__(self, analysis: type[Analysis], folder: Path, read: Read) -> None:
        self._analysis = analysis
        self._folder = folder
        self._read = read
        self._written = 0
        self._first: dict[int, tuple[RecordedSweep, Evaluation]] = {}

    def evaluate(self, case: Case, **written: Any) -> Evaluation:
        """Return the evaluation of a recording of ``case``; raises as the analysis does.

        ``written`` are arguments of :func:`write_case`.
        """
        return self._evaluated(self._recorded(case, **written))

    def found(self, cases: Sequence[Case]) -> Found | None:
        """Return what is found in recordings of ``cases``, all together; None if it is refused."""
        try:
            return self._read(self._evaluated(*map(self._recorded, cases)))
        except RigdError:
            return None

    def first(self, case: Case) -> tuple[RecordedSweep, Evaluation]:
        """Return a whole recording of ``case`` and its evaluation, made once."""
        if id(case) not in self._first:
            sweep = self._recorded(case)
            self._first[id(case)] = sweep, self._evaluated(sweep)
        return self._first[id(case)]

    def _recorded(self, case: Case, **written: Any) -> RecordedSweep:
        self._written += 1
        path = self._folder / f"case{self._written}.mcap"
        sweep = open_sweep(write_case(path, self._analysis, case, **written))
        check_plan(sweep.plan, self._analysis)
        return sweep

    def _evaluated(self, *sweeps: RecordedSweep, options: Options | None = None) -> Evaluation:
        return evaluate_sweeps(self._analysis, sweeps, options or Options(), lambda _: None)

    def declared(self) -> Iterator[tuple[str, str]]:
        needs = self._analysis.needs
        for name, unit in {**needs.signals, **needs.optional_signals}.items():
            try:
                for item in choices(unit):
                    parse_unit("1" if item == ANY_UNIT else item)
            except ValueError as error:
                yield f"signal {name}: {error}", "give a unit that rigd knows, such as N m/V"
        constants = (*needs.constants, *needs.optional_constants)
        for name, unit in needs.constant_units.items():
            if name not in constants:
                yield (
                    f"there is no constant {name!r} that has a unit",
                    "name it in `constants` or `optional_constants` too",
                )
            try:
                parse_unit(unit)
            except ValueError as error:
                yield f"constant {name}: {error}", "give a unit that rigd knows, 1 for a number"
        if not needs.signals:
            yield "it needs no signal", "name the signals that it works from in `needs`"
        used = (*needs.calibrated, *needs.calibrated_if_known, *self._analysis.measures)
        for name in used:
            if name not in self._analysis.calibratable:
                yield (
                    f"the calibrated value {name} has no meaning",
                    "declare it in `calibratable`, with its unit",
                )
        if not (self._analysis.__doc__ or "").strip():
            yield "the class has no docstring", "its first line stands in `rigd analyses`"

    @cached_property
    def heavy(self) -> list[str] | None:
        """What importing the module of the analysis imports; None: it is of no package."""
        code = (
            f"import sys\nsys.path[:] = {sys.path!r}\nimport {self._analysis.__module__}\n"
            f"print(*[name for name in {_HEAVY!r} if name in sys.modules])"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=False
        )
        return done.stdout.split() if done.returncode == 0 else None

    def light(self) -> Iterator[tuple[str, str]]:
        if self.heavy:
            yield (
                f"its module imports {', '.join(self.heavy)}",
                "import numerics in `evaluate`: every check of a plan imports the module",
            )

    def truth(self, case: Case) -> Iterator[tuple[str, str]]:
        try:
            found = self._read(self.first(case)[1])
        except RigdError as error:
            yield f"it refuses the case: {error}", "evaluate what the case simulates"
            return
        yield from self._misses(case, found)
        for name, symbol in _symbols(self.first(case)[1]).items():
            if symbol != case.symbols.get(name, symbol):
                yield (
                    f"the report calls {name} {symbol}, and it is {case.symbols[name]}",
                    "give quantities in the order of the parameters",
                )

    def slower(self, case: Case) -> Iterator[tuple[str, str]]:
        """Look for a rate that is written into the analysis: every second sample is left out."""
        halved = replace(case, trials=[_every_second(trial) for trial in case.trials])
        try:
            found = self._read(self.evaluate(halved))
        except RigdError:
            return  # it may need the rate, if it says so
        for problem, demand in self._misses(halved, found, open_ends=True):
            yield f"with every second sample {problem}", f"take times from `t_s`; or {demand}"

    def permuted(self, case: Case) -> Iterator[tuple[str, str]]:
        """Look for what depends on order or number of trials, or on how people read channels."""
        numbers = [3 + 4 * index for index in range(len(case.trials))]
        try:
            found = self._read(self.evaluate(rotated(case), numbers=numbers, displayed=True))
        except RigdError as error:
            yield (
                f"with its trials in another order it is refused: {error}",
                "take them as they come",
            )
            return
        for problem, demand in self._misses(case, found, open_ends=True):
            yield (
                f"with its trials in another order {problem}",
                f"take each for itself; or {demand}",
            )

    def constants(self, case: Case) -> Iterator[tuple[str, str]]:
        """Look for constants that are written into the analysis: all are altered."""
        if not self._analysis.needs.constants:
            return
        changed = self.found([altered_constants(case, len(case.trials))])
        first = self._whole(case)
        if first == changed and any(interval is not None for interval in (first or {}).values()):
            yield (
                "with all constants a tenth larger it finds the same intervals",
                "take each constant of `needs` from the recording",
            )

    def each_trial(self, case: Case) -> Iterator[tuple[str, str]]:
        if (whole := self._whole(case)) is not None:
            yield from counts_by_its_data(case, self.found, whole)
            turned = self.found([rotated(case)])
            yield from constants_count_anywhere(case, self.found, whole, turned)
            yield from whole_in_parts(case, self.found, whole)

    def measured(self, case: Case) -> Iterator[tuple[str, str]]:
        if (whole := self._whole(case)) is None:
            return
        yield from held_samples(case, self.found, whole)
        for spoilt, found, less in spoilt_samples(case, self.found):
            words = "with a trial that ends in samples that are no numbers"
            demand = "refuse it with a sentence, or leave these samples out"
            for problem, _ in self._misses(spoilt, found, open_ends=True):
                yield f"{words} {problem}", demand
            for name in case.truth:
                if wider(name, found, less) > SPOILT_WIDTH:
                    yield f"{words} {name} is known far less than without that trial", demand

    def fits(self, case: Case) -> Iterator[tuple[str, str]]:
        """Look at the fits of the library that the analysis makes: derivatives, starts, seed."""
        taken = self._analysis.options
        options = Options(
            starts=3 if "starts" in taken else Options.starts,
            seed=7 if "seed" in taken else Options.seed,
        )
        with suppress(RigdError), watched_fits() as seen:
            self._evaluated(self.first(case)[0], options=options)
            for model, theta in seen.models:
                for problem in dict.fromkeys(wrong_derivatives(model, theta)):
                    yield problem, "return the exact derivatives: intervals follow from them"
                signals = [item for trial in case.trials for item in trial.signals.values()]
                if repeats(model, theta) > REPEATED + max(map(held, signals)):
                    yield (
                        "residuals repeat the one before, and the signals do not",
                        "count what is computed from the same samples once",
                    )
            for index, name in enumerate(("starts", "seed")):
                asked = {item[index] for item in seen.asked}
                if name in taken and asked and getattr(options, name) not in asked:
                    yield f"it takes the option {name}, and fits with another", "pass `options` on"

    def random_truths(self, drawn: Drawn, seed: int) -> Iterator[tuple[str, str]]:
        errors: dict[str, list[float]] = {}
        for number in range(_DRAWS):
            case = drawn(np.random.default_rng((seed, number)))
            try:
                found = self._read(self.evaluate(case))
            except RigdError as error:
                yield (
                    f"it refuses a case that was drawn: {error}",
                    "evaluate what `drawn` simulates",
                )
                return
            missed = list(self._misses(case, found, open_ends=True))
            if missed:
                yield from ((f"in draw {number + 1} {words}", demand) for words, demand in missed)
                return
            for name, value in case.truth.items():
                interval = found.get(name)
                if interval is not None and interval[1] > interval[0]:
                    half = 0.5 * (interval[1] - interval[0])
                    error_ = (value - 0.5 * (interval[0] + interval[1])) / half
                    errors.setdefault(name, []).append(error_)
        for name in case.truth:
            rms = math.sqrt(np.mean(np.square(errors.get(name, [math.inf]))))
            if not rms <= _RMS:
                yield (
                    f"{name} is found in none of {_DRAWS} draws"
                    if math.isinf(rms)
                    else f"{name} is {rms:.2g} half widths from the truth, rms of {_DRAWS} draws",
                    "correct the estimate, or widen its interval by what it does not include",
                )

    def _whole(self, case: Case) -> Found | None:
        with suppress(RigdError):  # reported by the rule on the truth
            return self._read(self.first(case)[1])
        return None

    def _misses(
        self, case: Case, found: Mapping[str, Interval], *, open_ends: bool = False
    ) -> Iterator[tuple[str, str]]:
        """Yield where intervals do not hold the truth; ``open_ends``: they may be wide, or none."""
        for name, value in case.truth.items():
            interval = found.get(name)
            if interval is None:
                if open_ends:
                    continue
                yield f"{name} is not found, the truth is {value:g}", "find it, or call it unknown"
                continue
            middle, half = 0.5 * (interval[0] + interval[1]), 0.5 * (interval[1] - interval[0])
            if not abs(value - middle) <= _SURPRISE * half:
                shown = f"{interval[0]:g} to {interval[1]:g}"
                yield (
                    f"{name} is {shown}, the truth is {value:g}",
                    "correct the estimate, or widen its interval by what it does not include",
                )
            elif value and half > _WIDEST * abs(value) and not open_ends:
                yield f"{name} is known to ±{half:g} only", "simulate data that hold it"
        for name in case.unknown:
            interval = found.get(name)
            if interval is not None:
                yield (
                    f"{name} is {interval[0]:g} to {interval[1]:g}, which these data cannot hold",
                    "report it as not identifiable, and give no number",
                )

    def repeatable(self, case: Case) -> Iterator[tuple[str, str]]:
        try:
            sweep, first = self.first(case)
            second = self._evaluated(sweep)
        except RigdError:
            return  # reported by the rule on the truth
        texts = [json.dumps(item.to_json(), allow_nan=False) for item in (first, second)]
        if texts[0] != texts[1]:
            yield (
                "two evaluations of a recording give two JSON objects",
                "seed what is drawn from `options.seed`, and leave what is given unchanged",
            )
        yield from _ragged(first)
        page = first.report()
        if first.title not in page or "<html" not in page:
            yield "the report is no page with its title", "draw it with rigd.analysis.report"
        if _MADE.sub("", page) != _MADE.sub("", first.report()):
            yield "two reports on one evaluation differ", "draw nothing at random"

    def refusals(self, case: Case) -> Iterator[tuple[str, str]]:
        for name in self._analysis.needs.signals:
            yield from self._refused(_without(case, name), f"without the signal {name}")
        for name in self._analysis.needs.constants:
            left = {key: value for key, value in case.constants.items() if key != name}
            yield from self._refused(replace(case, constants=left), f"without the constant {name}")
        if self._analysis.needs.calibrated:
            yield from self._refused(replace(case, calibration=""), "without a calibration")
        spoilt = replace(case, trials=[_not_numbers(trial) for trial in case.trials])
        yield from self._refused(spoilt, "of samples that are no numbers")
        for count, which in ((2, "of trials of two samples"), (1, "of trials of one sample")):
            short = replace(case, trials=[_part(trial, slice(count)) for trial in case.trials])
            yield from self._refused(short, which, answers=True)
        yield from self._refused(case, "of trials that did not come to their end", complete=False)

    def _refused(
        self, case: Case, which: str, *, complete: bool = True, answers: bool = False
    ) -> Iterator[tuple[str, str]]:
        """Yield what is wrong if a recording is neither refused nor found to hold nothing.

        With ``answers`` it may hold something: then only how it is refused counts.
        """
        demand = "raise DataError with a sentence and a hint"
        if not case.trials[0].signals:
            return  # a recording without any stream is refused before the analysis sees it
        try:
            found = self._read(self.evaluate(case, complete=complete))
        except RigdError as error:
            if len(error.message.split()) < 3:
                yield f"a recording {which} is refused with {error.message!r}", demand
        except Exception as error:  # noqa: BLE001  # what it raises is what is reported
            yield f"a recording {which} raises {type(error).__name__}: {error}", demand
        else:
            numbers = [name for name, interval in found.items() if interval is not None]
            if numbers and not answers:
                yield f"a recording {which} gives {', '.join(numbers)}", demand


def _symbols(evaluation: Evaluation) -> Mapping[str, str]:
    """Return the symbols of a report by the names of the parameters."""
    if not isinstance(evaluation, ParameterEvaluation):
        return {}
    return {
        item.name: item.symbol
        for section in evaluation.sections
        for item in (*section.result.parameters, *section.result.derived)
    }


def _ragged(evaluation: Evaluation) -> Iterator[tuple[str, str]]:
    for part in evaluation.terminal_report():
        if isinstance(part, TerminalTable) and any(
            len(row.cells) != len(part.columns) for row in part.rows
        ):
            yield "a table has rows of another length than its head", "give every column a cell"


def _without(case: Case, name: str) -> Case:
    trials = [
        replace(trial, signals={key: value for key, value in trial.signals.items() if key != name})
        for trial in case.trials
    ]
    return replace(case, trials=trials)


def _every_second(trial: SimulatedTrial) -> SimulatedTrial:
    return _part(trial, slice(None, None, 2))


def _part(trial: SimulatedTrial, part: slice) -> SimulatedTrial:
    def of(values: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
        return {name: item[part] for name, item in values.items()}

    t_s = trial.t_s[part]
    steps = {name: begin for name, begin in trial.steps.items() if begin <= t_s[-1]}
    return replace(
        trial, t_s=t_s, signals=of(trial.signals), channels=of(trial.channels), steps=steps
    )


def _not_numbers(trial: SimulatedTrial) -> SimulatedTrial:
    nothing = np.full(len(trial.t_s), math.nan)
    return replace(trial, signals=dict.fromkeys(trial.signals, nothing))
