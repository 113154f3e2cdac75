"""What stands behind a link, in memory, for the tests of the conformance suites."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import pytest

from rigd.sdk.check import Peer, Report

#: Those of the line: what is in memory has no actuator of its own.
FAULTS = ("dead", "silent", "late", "garbled", "frozen", "lossy")


class Wire:
    """Takes one session at a time, and shows one fault at a time."""

    def __init__(self) -> None:
        self.fault = ""
        self.taken = False
        self.acted: list[str] = []

    def begin(self, fault: str) -> None:
        self.fault = fault

    def peer(self, link: Callable[[], Any] | None = None) -> Peer:
        """Return the peer of a driver; without ``link`` the driver gets the wire itself."""
        return Peer(
            link=link or (lambda: self), faults={name: partial(self.begin, name) for name in FAULTS}
        )


def each_mistake(bad: Sequence[tuple[str, type[Any], str]]) -> pytest.MarkDecorator:
    """Run a test for each mistake: the rule that it breaks, its driver, words of the finding."""
    names = ("rule", "driver", "words")
    return pytest.mark.parametrize(names, bad, ids=lambda item: getattr(item, "__name__", ""))


def assert_found(report: Report, rule: str, words: str) -> None:
    """Assert that ``rule`` alone is broken, and that a finding has ``words``."""
    assert {finding.rule for finding in report.findings} == {rule}
    assert any(words in finding.problem for finding in report.findings), str(report)
