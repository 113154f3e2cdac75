"""Defines the report on a driver or a plant that was checked against the rules of the SDK.

A plant is the physics of a simulated rig. The report lists the rules that were checked, every
broken rule with what was observed and what the rule requires, and the rules that could not be
checked with what was missing. :class:`NonConforming` is the error that a failed check raises.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

from rigd.sdk.check.caller import Hung
from rigd.sdk.check.sequences import StepFailed
from rigd.sdk.check.subject import NamedRule, UnfitSubject

R = TypeVar("R", bound=NamedRule)


@dataclass(frozen=True)
class Finding:
    """A breach of a rule: the observation, and the requirement of the rule."""

    rule: str
    problem: str
    demand: str

    def __str__(self) -> str:
        return f"{self.rule}: {self.problem}\n    {self.demand}"


@dataclass(frozen=True)
class Report:
    """The outcome of one examination: rules kept, rules broken, and rules that could not run."""

    subject: str
    findings: tuple[Finding, ...] = ()
    checked: tuple[str, ...] = ()
    #: Rules that did not run, and what was missing for each.
    skipped: Mapping[str, str] = field(default_factory=dict)
    #: What was drawn at random was drawn from it; None: nothing was.
    seed: int | None = None
    #: What could not be judged in rules that were checked, and why.
    notes: tuple[str, ...] = ()

    def __str__(self) -> str:
        seed = "" if self.seed is None else f", seed {self.seed}"
        lines = [f"{self.subject}: {len(self.checked)} rules checked{seed}"]
        lines += [f"  {finding}" for finding in self.findings]
        lines += [f"  {note}" for note in self.notes]
        for why in dict.fromkeys(self.skipped.values()):
            rules = ", ".join(rule for rule, reason in self.skipped.items() if reason == why)
            lines.append(f"  not checked, for {why}: {rules}")
        return "\n".join(lines)


class NonConforming(AssertionError):
    """A driver or a plant breaks rules of the SDK; ``report`` holds all of them."""

    def __init__(self, report: Report) -> None:
        broken = len({finding.rule for finding in report.findings})
        super().__init__(f"{broken} rules broken\n{report}")
        self.report = report


def all_of(problems: Callable[[], Iterable[str]]) -> list[str]:
    """Return what a rule yields, and what ends it."""
    found: list[str] = []
    try:
        found += problems()
    except (UnfitSubject, Hung, StepFailed) as unfit:
        found.append(str(unfit))
    return found


def examine(
    subject: str,
    stages: Sequence[Sequence[R]],
    problems: Callable[[R], Iterable[str]],
    missing: Callable[[R], str],
    *,
    gates: Collection[str],
    only: Collection[str],
    seed: int | None = None,
    notes: Sequence[str] = (),
) -> Report:
    """Apply rules stage by stage; a broken rule of ``gates`` prevents the following stages.

    ``problems`` applies a rule, ``missing`` returns why a rule cannot be applied, or "". ``only``
    are names of the rules to apply; empty: all. ``notes`` are read at the end.

    Raises:
        ValueError: there is no such rule.
    """
    known = [rule.name for rules in stages for rule in rules]
    if unknown := set(only) - set(known):
        raise ValueError(f"no rule {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    findings: list[Finding] = []
    checked: list[str] = []
    skipped: dict[str, str] = {}
    for rules in stages:
        stopped = any(finding.rule in gates for finding in findings)
        for rule in rules:
            if only and rule.name not in only:
                continue
            if reason := "correct the findings above first" if stopped else missing(rule):
                skipped[rule.name] = reason
                continue
            checked.append(rule.name)
            found = all_of(partial(problems, rule))
            findings += [Finding(rule.name, item, rule.demand) for item in found]
    return Report(subject, tuple(findings), tuple(checked), skipped, seed, tuple(notes))
