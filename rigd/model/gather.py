"""Copies numbers from a table of the cycle into the memory of a compiled function, many at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from operator import itemgetter
from struct import Struct
from typing import Any, Literal

#: ``copy(table)``: copies numbers of the table.
Copy = Callable[[Sequence[float]], None]


def copies(kind: Literal["d", "q"], places: Mapping[int, int], memory: Any) -> list[Copy]:
    """Return what copies all of ``places``, the place in ``memory`` of each with that in the table.

    ``memory`` is a writable buffer of float64 (``d``) or int64 (``q``). Places that follow one
    another in the memory are copied at once: each alone costs as much as eight of them.
    """
    ordered = sorted(places)
    blocks = groupby(enumerate(ordered), key=lambda item: item[1] - item[0])
    found = []
    for _, block in blocks:
        targets = [target for _, target in block]
        found.append(_copy(kind, targets[0], [places[target] for target in targets], memory))
    return found


def _copy(kind: str, first: int, sources: Sequence[int], memory: Any) -> Copy:
    pack = Struct(f"={len(sources)}{kind}").pack_into
    get, begin = getter(sources), 8 * first

    def copy(table: Sequence[float]) -> None:
        pack(memory, begin, *get(table))

    return copy


def getter(places: Sequence[int]) -> Callable[[Sequence[float]], Sequence[float]]:
    """Return what takes the numbers at ``places``, at least one, from a table."""
    # With one place only, itemgetter gives the number itself; of a slice it gives a sequence.
    if len(places) == 1:
        return itemgetter(slice(places[0], places[0] + 1))
    return itemgetter(*places)
