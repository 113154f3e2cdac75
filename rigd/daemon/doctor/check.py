"""Defines the result of one check of ``rigd doctor``: the verdict and the remedy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum


class CheckVerdict(Enum):
    """The verdict of a check."""

    OK = "ok"
    WARN = "warn"  #: fit, with a disadvantage
    FAIL = "fail"  #: not fit


@dataclass(frozen=True)
class Check:
    """The result of one check.

    ``found`` is a sentence for a person, ``advice`` the remedy if the verdict is not ok,
    ``figures`` the numbers for a script, in SI.
    """

    group: str
    name: str
    verdict: CheckVerdict
    found: str
    advice: str = ""
    figures: Mapping[str, object] = field(default_factory=dict)


def is_fit(checks: Iterable[Check]) -> bool:
    """Return whether none of ``checks`` fails."""
    return all(check.verdict is not CheckVerdict.FAIL for check in checks)


#: Takes every check as soon as it is made.
OnCheck = Callable[[Check], None]
