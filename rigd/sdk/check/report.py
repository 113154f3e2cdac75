"""Defines the report on a driver or a plant that was checked against the rules of the SDK.

A plant is the physics of a simulated rig. The report lists the rules that were checked, every
broken rule with what was observed and what the rule requires, and the rules that could not be
checked with what was missing. :class:`NonConforming` is the error that a failed check raises.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


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

    def __str__(self) -> str:
        lines = [f"{self.subject}: {len(self.checked)} rules checked"]
        lines += [f"  {finding}" for finding in self.findings]
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
