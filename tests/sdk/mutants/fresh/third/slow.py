"""Mistakes in a thermometer on TCP that the daemon asks."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "degrees and hundredths are added whatever the sign",
        "-23.45 C shows as -22.55 C, and -0.30 C as +0.30 C",
        (
            (
                r'rb"T=(?P<celsius>[-+]\d{3}\.\d\d) C"',
                r'rb"T=(?P<whole>[-+]\d{3})\.(?P<part>\d\d) C"',
            ),
            (
                'float(match["celsius"]) + ICE_POINT_K',
                'int(match["whole"]) + int(match["part"]) / 100 + ICE_POINT_K',
            ),
        ),
        file="protocol",
    ),
    Fresh(
        "a row is the median of the last three readings",
        "a short peak of the temperature is never recorded, and no limit on it acts",
        (
            (
                "        while True:\n            kelvin",
                "        last: list[float] = []\n        while True:\n            kelvin",
            ),
            (
                "            emit(CLSRow.of(temperature=kelvin))\n",
                "            last = [*last, kelvin][-3:]\n"
                "            emit(CLSRow.of(temperature=sorted(last)[len(last) // 2]))\n",
            ),
        ),
    ),
    Fresh(
        "a reading as the one before is not emitted",
        "at a steady temperature the thermometer counts as silent, and the run is ended",
        (
            (
                "        while True:\n            kelvin",
                "        before = 0.0\n        while True:\n            kelvin",
            ),
            (
                "            emit(CLSRow.of(temperature=kelvin))\n",
                "            if kelvin != before:\n"
                "                emit(CLSRow.of(temperature=kelvin))\n"
                "            before = kelvin\n",
            ),
        ),
    ),
    Fresh(
        "any answer to the zero means that it is set",
        "the device refuses to set its zero, and the operator reads that it is set",
        (
            (
                '        if answer != b"OK":\n'
                '            raise DeviceError(f"the device refuses to set its zero: {answer!r}")\n'
                '        return "zero set"\n',
                '        return "zero set" if answer else "no answer"\n',
            ),
        ),
    ),
    Fresh(
        "close raises if the connection is lost",
        "one dead thermometer spoils the end of the run: what is closed after it stays open",
        (
            (
                "            with contextlib.suppress(OSError):  # the connection is lost already\n"
                "                await writer.wait_closed()\n",
                "            await writer.wait_closed()\n",
            ),
        ),
    ),
    Fresh(
        "the task that keeps the connection alive outlives it",
        "each start leaves one more task in the daemon, which asks beside the reader of the next",
        (
            (
                "        except BaseException:  # also when cancelled: nothing may stay open\n"
                "            await self.close()\n"
                "            raise\n",
                "        except BaseException:  # also when cancelled: nothing may stay open\n"
                "            await self.close()\n"
                "            raise\n"
                "        self._alive = asyncio.create_task(self._keep_alive())\n"
                "\n"
                "    async def _keep_alive(self) -> None:\n"
                "        while True:  # the device drops a connection that is idle for 10 s\n"
                "            await asyncio.sleep(5.0)\n"
                "            await self._ask(protocol.IDENTIFY)\n",
            ),
        ),
    ),
    Fresh(
        "readings come ten times a second at most",
        "the rig file asks for 50 readings in a second, and the recording has fewer than ten",
        (
            (
                "await asyncio.sleep(self.config.interval)",
                "await asyncio.sleep(max(self.config.interval, 0.1))",
            ),
        ),
    ),
    Fresh(
        "the zero waits for the sensor and stops the loop",
        "for 0.2 s the daemon hears no device, no command of the operator and no stop",
        (
            ("import contextlib\n", "import contextlib\nimport time\n"),
            (
                '        return "zero set"\n',
                '        time.sleep(0.2)  # the sensor settles\n        return "zero set"\n',
            ),
        ),
    ),
    Fresh(
        "the first row is the reading that open has taken",
        "a run that begins long after the start of the daemon opens with an old temperature",
        (
            (
                "        self._exchange = asyncio.Lock()",
                "        self._first = 0.0\n        self._exchange = asyncio.Lock()",
            ),
            (
                "            self.identity = protocol.parse_identity("
                "await self._ask(protocol.IDENTIFY))\n",
                "            self.identity = protocol.parse_identity("
                "await self._ask(protocol.IDENTIFY))\n"
                "            self._first = protocol.parse_reading(await self._ask(protocol.ASK))\n",
            ),
            (
                "        while True:\n            kelvin",
                "        emit(CLSRow.of(temperature=self._first))\n"
                "        while True:\n"
                "            kelvin",
            ),
        ),
    ),
)
