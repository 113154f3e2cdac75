"""Defines one number of an evaluation, or the reason why the data give none, for any analysis."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Share:
    """What one stated constant adds to an estimate: its ``effect`` if the constant is 1 u larger.

    ``stated`` and ``u`` are those of the constant, in its own unit and coordinate: where two
    estimates have the same, both rest on one constant, and its error is common to them.
    ``effect`` is in the unit of the estimate; of its logarithm if the estimate is ``log``.
    ``left`` is of an assumption of the model that no file states, such as an exponent: the part of
    its ``u`` that the data leave open, which is all that the interval holds. None: of the rig.
    """

    constant: str
    stated: float
    u: float
    effect: float
    left: float | None = None

    @property
    def held(self) -> float:
        """The standard deviation in the interval, with the sign of ``effect``."""
        return self.effect if self.left is None else self.effect * self.left

    def shape(self) -> dict[str, object]:
        """Return the fields of the JSON object; constants of the rig have no ``left``."""
        return {name: value for name, value in vars(self).items() if value is not None}


@dataclass(frozen=True)
class Estimate:
    """A parameter of one group of trials: ``value`` with its 95 % interval in ``unit``.

    ``value``, ``low`` and ``high`` are None if the data do not determine it, an end alone if the
    data leave that end open. ``verdict`` is how well it is determined, in the words of the table;
    ``reason`` is why, in a sentence or more, with what would help.

    ``shares`` are the parts of the interval that come from stated constants. ``log``: the interval
    is that of the logarithm. ``u`` is the standard uncertainty without the shares, with ``freedom``
    degrees of freedom; None: it follows from the interval, which is that of a normal distribution.
    ``is_within_run``: it holds what differs between trials of one run, and not how runs differ.
    """

    group: str
    name: str
    unit: str
    value: float | None
    low: float | None
    high: float | None
    determined: bool
    verdict: str
    reason: str = ""
    meaning: str = ""
    symbol: str = ""
    shares: tuple[Share, ...] = ()
    log: bool = False
    u: float | None = None
    freedom: float = math.inf
    is_within_run: bool = False

    def __repr__(self) -> str:
        shown = f"{self.group} {self.name}".strip()
        if self.value is None:
            return f"<{shown}: {self.verdict}>"
        low, high = ("open" if end is None else f"{end:.6g}" for end in (self.low, self.high))
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"<{shown}: {self.value:.6g}{unit}, {low} to {high}, {self.verdict}>"
