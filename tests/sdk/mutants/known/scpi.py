"""Mistakes in the driver with SCPI of `support.written_drivers`."""

from __future__ import annotations

from sdk.mutants.known import Mutant

MUTANTS = (
    Mutant(
        "armed for good",
        "any order of calls",
        "self._voltage, self._was_ready, self._due_s = None, False, 0.0",
        "self._due_s = 0.0",
    ),
    Mutant(
        "voltage sent when it is written",
        "any order of calls",
        "            self._voltage = min(max(voltage, 0.0), self.config.voltage_range)\n",
        "            before = getattr(self, '_told', None)\n"
        "            self._told = min(max(voltage, 0.0), self.config.voltage_range)\n"
        "            if self._told != before:\n"
        "                self._voltage = self._told\n",
    ),
    Mutant(
        "errors of others",
        "any order of calls",
        "            self._port.send(protocol.CLEAR)\n",
        "",
    ),
)
