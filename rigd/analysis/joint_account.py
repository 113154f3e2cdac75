"""Describes a joint fit in a result: the groups, the constants that they share, what it gained."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class ConstantAccount:
    """A shared constant as stated and as fitted, each with its standard uncertainty, in ``unit``.

    What is stated in proportion to something is as in the first group.
    """

    wording: str
    unit: str
    stated: float
    stated_u: float
    value: float
    u: float

    @property
    def text(self) -> str:
        """Return both with their uncertainties."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        stated = f"stated {self.stated:.5g} ± {self.stated_u:.2g}{unit}"
        return f"{stated}, fitted {self.value:.5g} ± {self.u:.2g}{unit}"


@dataclass(frozen=True)
class JointAccount:
    """What a reader is given of a joint fit.

    ``groups`` share the ``constants``, by name; ``narrower`` is, by group and parameter, the
    standard error as a share of that of the group by itself. ``sentences`` state it, and which
    groups were fitted by themselves and why.
    """

    groups: tuple[str, ...]
    constants: Mapping[str, ConstantAccount]
    narrower: Mapping[str, Mapping[str, float]]
    sentences: tuple[str, ...]

    @property
    def title(self) -> str:
        """Return the title of a table of the constants."""
        return f"constants of the rig, shared by {', '.join(self.groups)}"
