"""Mistakes in a thermometer on a serial port."""

from __future__ import annotations

from support.fresh_mutants import Fresh

MUTANTS = (
    Fresh(
        "the wait for an answer begins anew with each question",
        "a device that has gone silent is never reported",
        (
            (
                "            kelvin = await self._reading()\n",
                "            heard_s = loop.time()\n            kelvin = await self._reading()\n",
            ),
        ),
    ),
    Fresh(
        "a lost answer is recorded as the last temperature",
        "the recording has readings that the device has not given",
        (
            (
                "        return None if line is None else protocol.parse_reading(line)\n",
                "        if line is not None:\n"
                "            self._last = protocol.parse_reading(line)\n"
                '        return getattr(self, "_last", None)\n',
            ),
        ),
    ),
)
