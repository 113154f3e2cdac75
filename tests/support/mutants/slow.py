"""Mistakes in the slow driver that `rigd new driver --kind slow` writes."""

from __future__ import annotations

from support.mutants import Mutant

_EMIT = "            emit("
_ASK = "            kelvin = protocol.parse_reading(await self._ask(protocol.ASK))\n"
_SLEEP = "            await asyncio.sleep(self.config.interval)\n"
_NO_READING = """\
    if match is None:
        raise ProtocolError(
            f"expected a reading"""
_ZERO = "        answer = await self._ask(protocol.ZERO)\n"
_TIMEOUT = "            except TimeoutError as error:\n                raise DeviceError(\n"
_IDENTIFY = "            self.identity = "

MUTANTS = (
    # the event loop
    Mutant(
        "blocks for 50 ms",
        "never blocks",
        _SLEEP,
        "            __import__('time').sleep(0.05)\n" + _SLEEP,
    ),
    Mutant(
        "blocks while it asks",
        "never blocks",
        "            writer.write(command)\n",
        "            writer.write(command)\n            __import__('time').sleep(0.05)\n",
    ),
    Mutant("interval ignored", "not too often", _SLEEP, "            await asyncio.sleep(0)\n"),
    Mutant(
        "cancel swallowed once",
        "cancelled while it waits",
        _TIMEOUT,
        "            except asyncio.CancelledError:\n"
        '                if getattr(self, "_again", False):\n                    raise\n'
        "                self._again = True\n"
        '                raise DeviceError("interrupted") from None\n' + _TIMEOUT,
    ),
    Mutant(
        "cancel taken for a fault",
        "cancelled while it waits",
        "            except TimeoutError as error:\n",
        "            except (TimeoutError, asyncio.CancelledError) as error:\n",
    ),
    Mutant(
        "run returns when cancelled",
        "rows",
        _SLEEP,
        "            try:\n    " + _SLEEP + "            except asyncio.CancelledError:\n"
        "                return\n",
    ),
    # rows
    Mutant("bare number", "rows", _EMIT, "            (lambda row: emit(tuple(row)))("),
    Mutant("unit forgotten", "rows", " + ICE_POINT_K\n", "\n", "protocol"),
    Mutant(
        "factor of ten",
        "rows are true",
        'float(match["celsius"])',
        '0.1 * float(match["celsius"])',
        "protocol",
    ),
    Mutant(
        "sign lost",
        "rows are true",
        'float(match["celsius"])',
        'abs(float(match["celsius"]))',
        "protocol",
    ),
    Mutant(
        "NaN for a damaged line",
        "garbled",
        _NO_READING,
        '    if match is None:\n        return float("nan")\n' + _NO_READING,
        "protocol",
    ),
    Mutant(
        "zero for a damaged line",
        "garbled",
        _NO_READING,
        "    if match is None:\n        return ICE_POINT_K\n" + _NO_READING,
        "protocol",
    ),
    Mutant(
        "last reading for a damaged line",
        "garbled",
        _ASK,
        "            try:\n    " + _ASK + "            except ProtocolError:\n"
        '                kelvin = getattr(self, "_last", 273.15)\n'
        "            self._last = kelvin\n",
    ),
    Mutant(
        "last reading in silence",
        "silent",
        _ASK,
        "            try:\n    " + _ASK + "            except DeviceError:\n"
        '                kelvin = getattr(self, "_last", 273.15)\n'
        "            self._last = kelvin\n",
    ),
    Mutant(
        "each reading twice",
        "no row twice",
        _SLEEP,
        "            emit(self.declaration.row.of(temperature=kelvin))\n" + _SLEEP,
    ),
    # errors
    Mutant(
        "errors swallowed",
        "dead",
        _ASK,
        "            try:\n    " + _ASK + "            except DeviceError:\n"
        "                await asyncio.sleep(0.1)\n                continue\n",
    ),
    Mutant(
        "run returns when lost",
        "dead",
        _ASK,
        "            try:\n    " + _ASK + "            except DeviceError:\n"
        "                return\n",
    ),
    Mutant(
        "bare OSError",
        "dead",
        "            except (OSError, asyncio.IncompleteReadError) as error:\n"
        "                raise DeviceError(\n",
        "            except (OSError, asyncio.IncompleteReadError) as error:\n"
        "                raise OSError(\n",
    ),
    Mutant(
        "no hint",
        "not there",
        '                hint="check its supply, its cable and the address",\n',
        "",
    ),
    Mutant(
        "damaged line is a ValueError",
        "garbled at open",
        '        raise ProtocolError(\n            f"expected the identity',
        '        raise ValueError(\n            f"expected the identity',
        "protocol",
    ),
    # actions
    Mutant("action does nothing", "actions are done", _ZERO, '        answer = b"OK"\n'),
    Mutant(
        "action asks for a reading",
        "actions are done",
        _ZERO,
        '        await self._ask(protocol.ASK)\n        answer = b"OK"\n',
    ),
    Mutant(
        "any action zeroes", "actions", '        if action != "zero":\n', "        if not action:\n"
    ),
    # close
    Mutant(
        "task left",
        "opens",
        _IDENTIFY,
        "            asyncio.create_task(asyncio.sleep(60))\n" + _IDENTIFY,
    ),
    Mutant(
        "rows from a timer",
        "quiet after close",
        _SLEEP,
        "            asyncio.get_running_loop().call_later(0.2, emit, "
        "self.declaration.row.of(temperature=kelvin))\n" + _SLEEP,
    ),
    Mutant(
        "second close raises",
        "closed twice",
        "        if writer is not None:\n",
        "        if True:\n",
    ),
)
