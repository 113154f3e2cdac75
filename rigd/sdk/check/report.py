"""Result of the conformance suite: every violated rule with its remedy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Finding:
    """One breach of one rule: what was seen, what is asked for."""

    rule: str
    problem: str
    demand: str

    def __str__(self) -> str:
        return f"{self.rule}: {self.problem}\n    {self.demand}"


@dataclass(frozen=True)
class Report:
    """The outcome of one examination: rules kept, rules broken, and those that could not run."""

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
