"""Mistakes in a programmable supply."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "only positive codes are errors",
        "a voltage that the supply refuses (-222) is recorded as set; the load gets another",
        (('{match[\'text\']}" if code else "")', '{match[\'text\']}" if code > 0 else "")'),),
        file="protocol",
    ),
    Fresh(
        "a setpoint that changes is sent at once",
        "a ramp fills the queue of the supply: its output goes off seconds after the stop",
        (
            (
                "            self._voltage = min(max(voltage, 0.0), self.config.voltage_range)\n",
                "            voltage = min(max(voltage, 0.0), self.config.voltage_range)\n"
                "            if voltage != self._voltage:\n"
                "                self._voltage = voltage\n"
                "                self._port.send(protocol.setting(voltage))\n",
            ),
        ),
    ),
    Fresh(
        "the output is switched on, then set to 0 V",
        "the load gets a pulse of the voltage that the last user has left at the supply",
        (('b"VOLT 0;:OUTP ON\\n"', 'b"OUTP ON;:VOLT 0\\n"'),),
        file="protocol",
    ),
    Fresh(
        "the state is the end of any answer",
        "a reading that was due as it stopped says on: the person is sent to a supply that is off",
        (
            (
                '    match = _STATE.fullmatch(line.decode("latin-1").strip())\n',
                '    found = list(_STATE.finditer(line.decode("latin-1")))\n'
                "    match = found[-1] if found else None\n",
            ),
        ),
        file="protocol",
    ),
    Fresh(
        "the next question is due a period after the last was due",
        "it is due since the computer was started: the supply is asked without a pause",
        (
            (
                "            self._due_s = now_s + self.config.period\n",
                "            self._due_s += self.config.period  # exactly periodic\n",
            ),
        ),
    ),
    Fresh(
        "rows carry the time at which the next is due",
        "readings are stamped in the future: an interlock takes an old one for new",
        (
            (
                "        self._check(readings.state)\n",
                "        self._check(readings.state)\n"
                "        self.taken_ns = round(self._due_s * 1e9)\n",
            ),
        ),
    ),
    Fresh(
        "after make_safe() it still counts as ready before",
        "each stop on purpose is reported as a trip of the supply's protection",
        (
            (
                "        self._voltage, self._was_ready = None, False\n        if self._port",
                "        self._voltage = None\n        if self._port",
            ),
        ),
    ),
    Fresh(
        "opening sets 0 V",
        "a look at the readings takes the voltage from a heater that is switched on by hand",
        (('CLEAR: Final = b"*', 'CLEAR: Final = b"VOLT 0;:*'),),
        file="protocol",
    ),
    Fresh(
        "the rescue switches off only what it hears to be on",
        "a supply that hears but does not answer stays on after the cycle was killed",
        (
            (
                "            self._port.open()\n            self.make_safe()\n"
                "            self.confirm_safe()\n",
                "            self._port.open()\n"
                "            state = self._ask(protocol.STATE, protocol.parse_state, CONFIRM_S)\n"
                "            if state.output:\n"
                "                self.make_safe()\n"
                "                self.confirm_safe()\n",
            ),
        ),
    ),
    Fresh(
        "a voltage is sent only if it has changed",
        "armed anew with the setpoint of before, the output stays at 0 V, and no error tells it",
        (
            (
                "        self._output = False  # as the supply",
                "        self._sent: float | None = None\n"
                "        self._output = False  # as the supply",
            ),
            (
                "                self._port.send(protocol.poll(self._voltage))\n",
                "                same = self._voltage == self._sent\n"
                "                self._port.send(protocol.poll(None if same else self._voltage))\n"
                "                self._sent = self._voltage\n",
            ),
        ),
    ),
    Fresh(
        "it is not switched off while an answer is due",
        "the output stays on until the other devices are safe and this one is confirmed",
        (
            (
                "        if self._port.is_open:\n            self._port.send(protocol.SAFE)\n",
                "        if self._port.is_open and not self._questions.is_open:\n"
                "            self._port.send(protocol.SAFE)\n",
            ),
            (
                "        if self._port.is_open and self._ask(",
                "        if self._port.is_open:\n"
                "            self._port.send(protocol.SAFE)  # if an answer was due before\n"
                "        if self._port.is_open and self._ask(",
            ),
        ),
    ),
    Fresh(
        "half a line of the connection before is kept",
        "after a cable was pulled the supply is taken for another device, until rigd starts anew",
        (("            self._lines.clear()\n", ""),),
    ),
)
