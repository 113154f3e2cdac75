"""The fresh mutants of each kind of package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from support.fresh_mutants import Fresh, analysis, block, fast, plant, scpi, sensors, serial, slow
from support.fresh_mutants.second import analysis as analysis_2
from support.fresh_mutants.second import block as block_2
from support.fresh_mutants.second import fast as fast_2
from support.fresh_mutants.second import plant as plant_2
from support.fresh_mutants.second import scpi as scpi_2
from support.fresh_mutants.second import sensors as sensors_2
from support.fresh_mutants.second import serial as serial_2
from support.fresh_mutants.second import slow as slow_2

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

#: Those of the second author.
SECOND: Mapping[str, Sequence[Fresh]] = {
    "fast": fast_2.MUTANTS,
    "scpi": scpi_2.MUTANTS,
    "sensor": sensors_2.MUTANTS,
    "slow": slow_2.MUTANTS,
    "serial": serial_2.MUTANTS,
    "block": block_2.MUTANTS,
    "plant": plant_2.MUTANTS,
    "analysis": analysis_2.MUTANTS,
}
