"""The mutants of each kind of package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from support.mutants import Mutant, analysis, block, fast, plant, slow

KINDS: Mapping[str, Sequence[Mutant]] = {
    "fast": fast.MUTANTS,
    "slow": slow.MUTANTS,
    "block": block.MUTANTS,
    "plant": plant.MUTANTS,
    "analysis": analysis.MUTANTS,
}
