"""Mistakes in a thermometer on a serial port."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "a line that is no reading counts as the reading before",
        "with the wrong baud rate, or noise on the line, the last temperature is recorded for ever",
        (
            ("    LinkError,\n", "    LinkError,\n    ProtocolError,\n"),
            (
                "        self._exchange = asyncio.Lock()",
                "        self._last = 293.15\n        self._exchange = asyncio.Lock()",
            ),
            (
                "        return None if line is None else protocol.parse_reading(line)\n",
                "        if line is None:\n"
                "            return None\n"
                "        try:\n"
                "            self._last = protocol.parse_reading(line)\n"
                "        except ProtocolError:\n"
                "            pass  # one damaged line must not end the run\n"
                "        return self._last\n",
            ),
        ),
    ),
    Fresh(
        "the time of the last answer is that of the start",
        "from the third second on a single answer that is lost ends the run",
        (
            (
                "                heard_s = loop.time()\n                emit(",
                "                emit(",
            ),
        ),
    ),
    Fresh(
        "the port stays open if another device answers",
        "with the cable in its place the next start says that the port is open already",
        (
            (
                "        except BaseException:  # also when cancelled: nothing may stay open\n",
                "        except LinkError:\n",
            ),
        ),
    ),
    Fresh(
        "readings are rounded to 0.1 K",
        "a drift of some hundredths of a kelvin, which the device shows, is lost",
        (
            (
                "emit(CLSRow.of(temperature=kelvin))",
                "emit(CLSRow.of(temperature=round(kelvin - 273.15, 1) + 273.15))",
            ),
        ),
    ),
    Fresh(
        "a reading that is cancelled keeps the lock",
        "after a run that was stopped the zero never ends, and the next run gives no row",
        (
            (
                "        async with self._exchange:\n"
                "            line = await self._port.ask(protocol.ASK, lambda line: line,"
                " REPLY_S)\n",
                "        await self._exchange.acquire()\n"
                "        line = await self._port.ask(protocol.ASK, lambda line: line, REPLY_S)\n"
                "        self._exchange.release()\n",
            ),
        ),
    ),
    Fresh(
        "a jump of more than 5 K counts once it comes twice",
        "the first reading after a fast change is thrown away: a limit acts an interval late",
        (
            (
                "        heard_s = loop.time()\n        while True:\n",
                "        heard_s, before = loop.time(), None\n        while True:\n",
            ),
            (
                "                emit(CLSRow.of(temperature=kelvin))\n",
                "                if before is None or abs(kelvin - before) <= 5.0:\n"
                "                    emit(CLSRow.of(temperature=kelvin))\n"
                "                before = kelvin\n",
            ),
        ),
    ),
)
