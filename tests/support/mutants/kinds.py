"""The mutants of each kind of driver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from support.mutants import Mutant, fast

KINDS: Mapping[str, Sequence[Mutant]] = {"fast": fast.MUTANTS}
