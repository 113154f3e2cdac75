"""Mistakes in the slow driver that `rigd new driver --kind slow` writes."""

from __future__ import annotations

from sdk.mutants.known import Mutant

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
        "silent",
        _TIMEOUT,
        "            except asyncio.CancelledError:\n"
        '                if getattr(self, "_again", False):\n                    raise\n'
        "                self._again = True\n"
        '                raise DeviceError("interrupted") from None\n' + _TIMEOUT,
    ),
    Mutant(
        "cancel taken for a fault",
        "silent",
        "            except TimeoutError as error:\n",
        "            except (TimeoutError, asyncio.CancelledError) as error:\n",
    ),
    Mutant(
        "run returns when cancelled",
        "any order of calls",
        _SLEEP,
        "            try:\n    " + _SLEEP + "            except asyncio.CancelledError:\n"
        "                return\n",
    ),
    # rows
    Mutant(
        "bare number", "any order of calls", _EMIT, "            (lambda row: emit(tuple(row)))("
    ),
    Mutant("unit forgotten", "any order of calls", " + ICE_POINT_K\n", "\n", "protocol"),
    Mutant(
        "factor of ten",
        "any order of calls",
        'float(match["celsius"])',
        '0.1 * float(match["celsius"])',
        "protocol",
    ),
    Mutant(
        "sign lost",
        "any order of calls",
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
        "any order of calls",
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
    Mutant("action does nothing", "any order of calls", _ZERO, '        answer = b"OK"\n'),
    Mutant(
        "action asks for a reading",
        "any order of calls",
        _ZERO,
        '        await self._ask(protocol.ASK)\n        answer = b"OK"\n',
    ),
    Mutant(
        "any action zeroes",
        "any order of calls",
        '        if action != "zero":\n',
        "        if not action:\n",
    ),
    # close
    Mutant(
        "task left",
        "any order of calls",
        _IDENTIFY,
        "            asyncio.create_task(asyncio.sleep(60))\n" + _IDENTIFY,
    ),
    Mutant(
        "rows from a timer",
        "any order of calls",
        _SLEEP,
        "            asyncio.get_running_loop().call_later(0.2, emit, "
        "self.declaration.row.of(temperature=kelvin))\n" + _SLEEP,
    ),
    Mutant(
        "second close raises",
        "safe and closed before open",
        "        if writer is not None:\n",
        "        if True:\n",
    ),
    # in some orders of calls alone
    Mutant(
        "reading kept back",
        "any order of calls",
        _EMIT,
        "            kelvin, self._kelvin = getattr(self, '_kelvin', kelvin), kelvin\n" + _EMIT,
    ),
    Mutant(
        "first reading again and again",
        "any order of calls",
        _EMIT,
        "            kelvin = self._kelvin = getattr(self, '_kelvin', kelvin)\n" + _EMIT,
    ),
    Mutant(
        "small changes left out",
        "any order of calls",
        _EMIT,
        "            self._kelvin = kelvin = (\n"
        "                self._kelvin\n"
        "                if abs(kelvin - getattr(self, '_kelvin', 0)) < 20\n"
        "                else kelvin\n"
        "            )\n" + _EMIT,
    ),
    Mutant(
        "cold is not shown",
        "any order of calls",
        _EMIT,
        "            kelvin = max(kelvin, 273.15)\n" + _EMIT,
    ),
    Mutant(
        "runs once",
        "any order of calls",
        "        while True:\n",
        "        if getattr(self, '_ran', False):\n            return\n        self._ran = True\n"
        "        while True:\n",
    ),
    Mutant(
        "unknown action is done in silence",
        "any order of calls",
        '            raise ValueError(f"unknown action {action!r}: the only action is zero")\n',
        "            return 'done'\n",
    ),
    Mutant(
        "socket dropped",
        "any order of calls",
        "            writer.close()\n            with contextlib.suppress(OSError):"
        "  # the connection is lost already\n                await writer.wait_closed()\n",
        "            pass\n",
    ),
    Mutant(
        "socket left after a wrong device",
        "garbled at open",
        "            await self.close()\n            raise\n",
        "            self._kept, self._writer = self._writer, None\n            raise\n",
    ),
    Mutant(
        "thread left",
        "any order of calls",
        _IDENTIFY,
        "            import threading\n"
        "            threading.Thread(target=threading.Event().wait, daemon=True).start()\n"
        + _IDENTIFY,
    ),
    Mutant(
        "constructor connects",
        "constructor opens nothing",
        "        self._exchange = asyncio.Lock()",
        "        import socket\n"
        "        socket.create_connection((config.host, config.port), 1.0).close()\n"
        "        self._exchange = asyncio.Lock()",
    ),
    # cancelled, lost
    Mutant(
        "answer to a cancelled question",
        "any order of calls",
        "            self._owed += 1\n",
        "            self._owed = 1\n",
    ),
    Mutant(
        "zero takes its time",
        "never blocks",
        '        return "zero set"\n',
        '        __import__("time").sleep(0.1)\n        return "zero set"\n',
    ),
    Mutant(
        "five readings in a second at most",
        "not too often",
        _SLEEP,
        "            await asyncio.sleep(max(0.2, self.config.interval))\n",
    ),
)
