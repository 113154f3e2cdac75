"""Tests whether the residuals of a fit depend on anything: every source of error on every quantity.

An :class:`ErrorSource` is a place at which an error may enter (a reading, a force, the input). A
:class:`Context` is a quantity on which it may depend (time, position, speed, an angle, the trial).
For each pair, the functions of the context go through the source into the outputs, and the
residuals are tested for them (:mod:`rigd.analysis.output_error.score`). A family of rigs defines
its sources; the tests are the same for all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rigd.analysis.output_error.score import Columns
from rigd.analysis.result import FloatArray, Meaning

WAVES = 4  #: cosines over the range of a context
HARMONICS = 2  #: of a context that comes round
FEW = 12  #: values of a context that count as groups, as trials do
ANY = (-math.inf, math.inf)  #: size
POSITIVE = (0.0, math.inf)
MOST_GROUPS = 6  #: contrasts that are made of groups


@dataclass(frozen=True, eq=False)
class ErrorSource:
    """A place of an error: ``respond(trial, signals)`` makes outputs (n, m, c) of (n, c)."""

    name: str
    unit: str
    respond: Callable[[int, FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Context:
    """What an error may depend on: values (n,) of each trial.

    ``round_rad`` means that it is an angle; ``groups`` that its values are names, numbered.
    """

    name: str
    values: Sequence[FloatArray]
    round_rad: bool = False
    groups: bool = False

    def functions(self) -> list[FloatArray] | None:
        """Return functions of the context, (n, c) for each trial; None if it never changes."""
        if self.groups:
            return self._contrasts()
        if self.round_rad:
            return [_harmonics(angle) for angle in self.values]
        low = min(float(np.min(values)) for values in self.values)
        high = max(float(np.max(values)) for values in self.values)
        if not high > low:
            return None
        return [_waves((values - low) / (high - low)) for values in self.values]

    def _contrasts(self) -> list[FloatArray] | None:
        """Return trend, bow and so on over the groups in their order, up to ``MOST_GROUPS``."""
        names = np.unique(np.concatenate([np.unique(values) for values in self.values]))
        if names.size < 2:
            return None
        order = min(names.size - 1, MOST_GROUPS)
        position = np.linspace(-1.0, 1.0, names.size)
        basis, _ = np.linalg.qr(np.vander(position, order + 1, increasing=True))
        rows = basis[:, 1:] * np.sqrt(names.size)
        return [rows[np.searchsorted(names, values)] for values in self.values]


@dataclass(frozen=True, eq=False)
class Suspect:
    """Something that the model does not have and that may be.

    ``columns`` makes the change of the outputs for each unit of it, as :mod:`.score` has it.

    ``name`` is what it is, for a sentence; ``look`` what to check on the rig. ``special`` states
    that it is one thing with a name, not a dependence of any shape; ``each_trial`` that its amount
    may differ from trial to trial, as a phase does; ``meaning`` what it makes of the parameters.
    ``near`` makes the same thing a little otherwise (another length of what repeats), if it comes
    in all sizes. ``possible`` are the least and the largest size that it can have, in its unit:
    with another it is not the cause. ``u`` is the standard uncertainty of a single size that no
    file states: what the data leave open of it stays in the intervals; 0 if nothing does that is
    not significant. ``context`` is the quantity
    of a dependence, ``harmonics`` of how many waves it is the sum: first the cosines of all, then
    their sines. Things of one kind ``like``, such as delays, are easily taken for one another: all
    of them are fitted.
    """

    name: str
    unit: str
    columns: Callable[[], Columns]
    look: str = ""
    special: bool = False
    each_trial: bool = False
    meaning: Meaning = Meaning.NUISANCE
    near: Callable[[], Iterable[Suspect]] | None = None
    possible: tuple[float, float] = ANY
    u: float = math.inf
    context: str = ""
    harmonics: int = 0
    like: str = ""


def dependences(sources: Sequence[ErrorSource], contexts: Sequence[Context]) -> Iterator[Suspect]:
    """Yield an error that the model may lack for each pair of a source and a context.

    The error at the source is then a function of the context, of any shape. A context that never
    changes gives none.
    """
    for context in contexts:
        functions = context.functions()
        if functions is None:
            continue
        for source in sources:
            columns = partial(_responses, source, functions)
            look = f"whether {source.name} depends on {context.name}"
            yield Suspect(
                f"{source.name} that depends on {context.name}", source.unit, columns, look,
                context=context.name, harmonics=HARMONICS if context.round_rad else 0,
            )  # fmt: skip


def _responses(source: ErrorSource, functions: Sequence[FloatArray]) -> Columns:
    """Return what the functions (n, c) of each trial, as an error at the source, add to outputs."""
    return [source.respond(trial, part) for trial, part in enumerate(functions)]


def _waves(share: FloatArray) -> FloatArray:
    """Return cosines of 1 to ``WAVES`` half periods over 0 to 1."""
    return np.cos(np.pi * share[:, None] * np.arange(1, WAVES + 1))


def _harmonics(angle: FloatArray) -> FloatArray:
    """Return cosines, then sines, of 1 to ``HARMONICS`` times the angle in rad."""
    turned = angle[:, None] * np.arange(1, HARMONICS + 1)
    return np.concatenate([np.cos(turned), np.sin(turned)], axis=1)
