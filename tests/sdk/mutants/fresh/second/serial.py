"""Mistakes in a thermometer on a serial port."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "the clock of silence starts again without an answer",
        "a thermometer whose cable is out is never reported by its driver",
        (
            (
                "            kelvin = await self._reading()\n"
                "            if kelvin is not None:\n"
                "                heard_s = loop.time()\n",
                "            kelvin = await self._reading()\n"
                "            heard_s = loop.time()\n"
                "            if kelvin is not None:\n",
            ),
        ),
    ),
    Fresh(
        "the zero does not wait for its turn",
        "zero pressed in a run takes a reading as its answer: 'does not set its zero', though set",
        (
            (
                "        async with self._exchange:\n"
                "            answer = await self._port.ask(protocol.ZERO,",
                "        answer = await self._port.ask(protocol.ZERO,",
            ),
        ),
    ),
    Fresh(
        "a lost answer is recorded as 0 K",
        "one lost answer puts 0 K into the recording and trips an interlock on the temperature",
        (
            (
                "return None if line is None else protocol.parse_reading(line)",
                "return 0.0 if line is None else protocol.parse_reading(line)",
            ),
        ),
    ),
    Fresh(
        "open does not wait until the port is quiet",
        "after a kill the answer to the old question is taken for the identity: open fails",
        (("            await self._port.quiet(QUIET_S, timeout_s=REPLY_S)\n", ""),),
    ),
)
