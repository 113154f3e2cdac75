"""The mutants of each kind of driver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from support.mutants import Mutant, block, fast, slow

KINDS: Mapping[str, Sequence[Mutant]] = {
    "fast": fast.MUTANTS,
    "slow": slow.MUTANTS,
    "block": block.MUTANTS,
}
