"""Mistakes in a thermometer on a serial port."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "the action does not wait for its turn",
        "the action takes the temperature for its answer, the next row is the answer to the action",
        (
            (
                "        async with self._exchange:\n            answer = await",
                "        if action:\n            answer = await",
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
