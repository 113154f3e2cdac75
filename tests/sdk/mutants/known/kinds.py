"""The mutants of each kind of package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sdk.mutants.known import Mutant, analysis, block, fast, plant, scpi, serial, slow

KINDS: Mapping[str, Sequence[Mutant]] = {
    "fast": fast.MUTANTS,
    "scpi": scpi.MUTANTS,
    "slow": slow.MUTANTS,
    "serial": serial.MUTANTS,
    "block": block.MUTANTS,
    "plant": plant.MUTANTS,
    "analysis": analysis.MUTANTS,
}
