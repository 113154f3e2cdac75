"""Mistakes in a programmable supply, SCPI, with its voltage as setpoint."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "the setpoint has one decimal",
        "a setpoint of 1.26 V gives 1.3 V",
        (
            (
                '    setting = b"" if voltage is None else b"VOLT %.4f;:" % voltage\n',
                '    setting = b"" if voltage is None else b"VOLT %.1f;:" % voltage\n',
            ),
        ),
        "protocol",
    ),
    Fresh(
        "the status shows what was ordered",
        "the recording says that the output is on while the supply reports it off",
        (
            (
                "            status=OUTPUT if readings.state.output else 0,\n",
                "            status=OUTPUT if self._voltage is not None else 0,\n",
            ),
        ),
    ),
    Fresh(
        "the voltage stays when the output is switched off",
        "after the next arm the supply gives its last voltage until the first setpoint comes",
        (
            (
                'SAFE: Final = b"OUTP OFF;:VOLT 0\\n"\n',
                'SAFE: Final = b"OUTP OFF\\n"\n',
            ),
            (
                'ENABLE: Final = b"VOLT 0;:OUTP ON\\n"\n',
                'ENABLE: Final = b"OUTP ON\\n"\n',
            ),
        ),
        "protocol",
    ),
    Fresh(
        "setpoints are sent on after make_safe",
        "the supply that was made safe gets voltages: its front panel key gives them to the rig",
        (
            (
                "        self._voltage, self._was_ready = None, False\n        if",
                "        self._was_ready = False\n        if",
            ),
        ),
    ),
    Fresh(
        "only positive error numbers are errors",
        "the errors of SCPI are negative: a refused setpoint is not reported",
        (('if code else "")', 'if code > 0 else "")'),),
        "protocol",
    ),
    Fresh(
        "an answer that comes late answers the next question",
        "after one late answer each row has the voltage of a question before",
        (
            (
                "            self._questions.give_up(now_s, owed=True)\n",
                "            self._questions.give_up(now_s, owed=False)\n",
            ),
        ),
    ),
    Fresh(
        "the period of the rig file is ignored",
        "asked for a reading each second, the supply is asked 20 times a second",
        (
            (
                "            self._due_s = now_s + self.config.period\n",
                "            self._due_s = now_s + 0.05\n",
            ),
        ),
    ),
    Fresh(
        "a failed open takes a new port",
        "each try to open a supply that does not answer leaves a connection that nobody closes",
        (
            (
                "        except BaseException:\n            self.close()\n            raise\n",
                "        except BaseException:\n            self._port = BytePort(self.config)\n"
                "            raise\n",
            ),
        ),
    ),
    Fresh(
        "the rescue asks for the identity first",
        "a supply that obeys and does not answer is not switched off by the rescue",
        (
            (
                "            self._port.open()\n            self.make_safe()\n",
                "            self.open()\n            self.make_safe()\n",
            ),
        ),
    ),
)
