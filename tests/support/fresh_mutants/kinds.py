"""The fresh mutants of each kind of package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from support.fresh_mutants import Fresh, analysis, block, fast, plant, scpi, sensors, serial, slow

KINDS: Mapping[str, Sequence[Fresh]] = {
    "fast": fast.MUTANTS,
    "scpi": scpi.MUTANTS,
    "sensor": sensors.MUTANTS,
    "slow": slow.MUTANTS,
    "serial": serial.MUTANTS,
    "block": block.MUTANTS,
    "plant": plant.MUTANTS,
    "analysis": analysis.MUTANTS,
}
