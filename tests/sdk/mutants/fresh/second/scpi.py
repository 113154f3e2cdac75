"""Mistakes in a programmable supply."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "setpoints are taken before arm and after make_safe",
        "after make_safe the supply is set to a voltage again: it is there once OUTPUT is pressed",
        (
            (
                "        if self._voltage is not None:\n            self._voltage = min(",
                "        self._voltage = min(",
            ),
        ),
    ),
    Fresh(
        "half a line is kept when the port is opened again",
        "after a cable that was pulled in an answer the first open fails: 'another device'",
        (("            self._lines.clear()\n", ""),),
    ),
    Fresh(
        "the output is switched on before its voltage is 0",
        "when the rig is armed the load gets the last voltage for a moment",
        (('b"VOLT 0;:OUTP ON\\n"', 'b"OUTP ON;:VOLT 0\\n"'),),
        "protocol",
    ),
    Fresh(
        "only negative errors are errors",
        "errors of the maker (over-temperature, +301) are taken out of the queue and dropped",
        (("if code else", "if code < 0 else"),),
        "protocol",
    ),
    Fresh(
        "the next question is due a period after the last was due",
        "the supply is asked as fast as it answers, whatever the period in the rig file",
        (
            (
                "            self._due_s = now_s + self.config.period\n",
                "            self._due_s += self.config.period\n",
            ),
        ),
    ),
    Fresh(
        "make_safe does not forget that the output was on",
        "the second run of the day ends at once: 'the supply has switched its output off'",
        (
            (
                "        self._voltage, self._was_ready = None, False\n"
                "        if self._port.is_open:",
                "        self._voltage = None\n        if self._port.is_open:",
            ),
        ),
    ),
)
