"""Mistakes in a programmable supply."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "the voltage is set in steps of 10 mV",
        "a controller of a small voltage gets steps of 10 mV, and nothing below 5 mV",
        (
            (
                "self._voltage = min(max(voltage, 0.0), self.config.voltage_range)",
                "self._voltage = round(min(max(voltage, 0.0), self.config.voltage_range), 2)",
            ),
        ),
    ),
    Fresh(
        "errors of an earlier session stay in the queue",
        "the first run after a session of somebody else ends at once with an error of theirs",
        (("            self._port.send(protocol.CLEAR)\n", ""),),
    ),
    Fresh(
        "rescue does not look whether the output is off",
        "a supply that does not obey is reported as rescued, and its output stays on",
        (
            (
                "            self.make_safe()\n            self.confirm_safe()\n",
                "            self.make_safe()\n",
            ),
        ),
    ),
    Fresh(
        "a negative setpoint is taken without its sign",
        "a controller that undershoots zero drives the load with full voltage",
        (
            (
                "min(max(voltage, 0.0), self.config.voltage_range)",
                "min(abs(voltage), self.config.voltage_range)",
            ),
        ),
    ),
    Fresh(
        "the voltage of a row is the setpoint",
        "a supply at its current limit is recorded with the voltage that it does not give",
        (
            (
                "            voltage=readings.voltage,\n",
                "            voltage=self._voltage or 0.0,\n",
            ),
        ),
    ),
    Fresh(
        "a voltage is sent only if it is another than the last sent",
        "armed again within a period, or after a late answer, the supply has another voltage than"
        " the setpoint, for good",
        (
            (
                "        self._was_ready = False\n\n",
                "        self._was_ready = False\n        self._sent: float | None = None\n\n",
            ),
            (
                "                self._port.send(protocol.poll(self._voltage))\n",
                "                changed = self._voltage != self._sent\n"
                "                new = self._voltage if changed else None\n"
                "                self._port.send(protocol.poll(new))\n"
                "                self._sent = self._voltage\n",
            ),
        ),
    ),
    Fresh(
        "what was armed is armed when the port is opened again",
        "closed after an error and opened again, setpoints reach the output though nobody armed it",
        (
            (
                "self._voltage, self._was_ready, self._due_s = None, False, 0.0",
                "self._was_ready, self._due_s = False, 0.0",
            ),
        ),
    ),
    Fresh(
        "only an output that was reported on is switched off",
        "stopped right after arm the output stays on, and nothing else would switch it off",
        (
            (
                "        self._voltage, self._was_ready = None, False\n"
                "        if self._port.is_open:\n",
                "        self._voltage, self._was_ready = None, False\n"
                "        if self._port.is_open and self._output:\n",
            ),
        ),
    ),
)
