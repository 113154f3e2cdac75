"""Mistakes in the driver on a serial line of `support.written_drivers`."""

from __future__ import annotations

from sdk.mutants.known import Mutant

MUTANTS = (
    Mutant(
        "the second lost answer ends the run",
        "silent",
        "            elif loop.time() - heard_s > GIVE_UP_S:\n",
        "            elif setattr(self, '_lost', getattr(self, '_lost', 0) + 1)"
        " or self._lost > 1:\n",
    ),
    Mutant(
        "large steps are thrown away",
        "any order of calls",
        "            if kelvin is not None:\n",
        "            before, self._before = getattr(self, '_before', None), kelvin\n"
        "            if kelvin is not None and abs(kelvin - (before or kelvin)) < 9.0:\n",
    ),
)
