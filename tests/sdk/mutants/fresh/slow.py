"""Mistakes in a thermometer that is asked on TCP."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_LOOP = (
    "            kelvin = protocol.parse_reading(await self._ask(protocol.ASK))\n"
    "            emit(CLSRow.of(temperature=kelvin))\n"
)
_SLEEP = "            await asyncio.sleep(self.config.interval)\n"

MUTANTS = (
    Fresh(
        "0 degrees Celsius are 273 K",
        "every temperature is 0.15 K too low",
        (("ICE_POINT_K: Final = 273.15", "ICE_POINT_K: Final = 273.0"),),
        "protocol",
    ),
    Fresh(
        "readings are rounded to 0.1 degrees",
        "the device gives hundredths, the recording has steps of 0.1 K",
        (
            (
                'float(match["celsius"]) + ICE_POINT_K',
                'round(float(match["celsius"]), 1) + ICE_POINT_K',
            ),
        ),
        "protocol",
    ),
    Fresh(
        "a row is emitted only if the reading has changed",
        "a constant temperature passes for a device that has failed, after 2 s",
        (
            ("        while True:\n", "        last = 0.0\n        while True:\n"),
            (
                _LOOP,
                _LOOP.replace(
                    "            emit(",
                    "            if kelvin != last:\n                emit(",
                )
                + "            last = kelvin\n",
            ),
        ),
    ),
    Fresh(
        "three missing answers are bridged with the last reading",
        "for 1.5 s the recording has new rows of a device that gives no answer",
        (
            (
                "        while True:\n",
                "        kelvin, missed = 0.0, 0\n        while True:\n",
            ),
            (
                _LOOP,
                "            try:\n"
                "                kelvin = protocol.parse_reading(await self._ask(protocol.ASK))\n"
                "                missed = 0\n"
                "            except DeviceError:\n"
                "                missed += 1\n"
                "                if missed > 3 or not kelvin:\n"
                "                    raise\n"
                "            emit(CLSRow.of(temperature=kelvin))\n",
            ),
        ),
    ),
    Fresh(
        "the interval of the rig file is ignored",
        "a rig file that asks for 10 ms gets a reading each 100 ms",
        ((_SLEEP, "            await asyncio.sleep(0.1)\n"),),
    ),
    Fresh(
        "each question has a lock of its own",
        "an action gets the temperature as its answer, the next row is the answer to the action",
        (("        async with self._exchange:\n", "        async with asyncio.Lock():\n"),),
    ),
    Fresh(
        "a question without an answer is asked again",
        "the late answer is taken for that of the next question: from then on each row is old",
        (
            (
                "            writer.write(command)\n"
                "            self._owed += 1\n"
                "            try:\n"
                "                async with asyncio.timeout(REPLY_S):\n"
                "                    while self._owed:  # those to questions that were cancelled "
                "come first\n"
                "                        line = await reader.readuntil(protocol.END)\n"
                "                        self._owed -= 1\n"
                "            except TimeoutError as error:\n",
                "            self._owed += 1\n"
                "            try:\n"
                "                for left in (2, 1, 0):\n"
                "                    writer.write(command)\n"
                "                    try:\n"
                "                        async with asyncio.timeout(REPLY_S):\n"
                "                            while self._owed:\n"
                "                                line = await reader.readuntil(protocol.END)\n"
                "                                self._owed -= 1\n"
                "                        break\n"
                "                    except TimeoutError:\n"
                "                        if not left:\n"
                "                            raise\n"
                "            except TimeoutError as error:\n",
            ),
        ),
    ),
    Fresh(
        "a second try of open drops the first connection",
        "a device that was slow at first leaves a connection behind with each open",
        (
            (
                "        except BaseException:  # also when cancelled: nothing may stay open\n",
                "        except DeviceError:\n"
                "            self._reader, self._writer = await asyncio.open_connection(\n"
                "                host, port, limit=LINE_BYTES\n"
                "            )\n"
                "            self.identity = protocol.parse_identity("
                "await self._ask(protocol.IDENTIFY))\n"
                "        except BaseException:\n",
            ),
        ),
    ),
    Fresh(
        "run polls in a task that it leaves behind",
        "after the run ends rows come on, of a device that nobody reads any more",
        (
            (
                "        while True:\n",
                "        polling = asyncio.create_task(self._poll(emit))\n"
                "        while not polling.done():\n"
                "            await asyncio.sleep(0.05)\n"
                "        polling.result()\n\n"
                "    async def _poll(self, emit: EmitRow) -> None:\n"
                "        while True:\n",
            ),
        ),
    ),
    Fresh(
        "the answer to the action is not looked at",
        "a refused zero is reported as set",
        (('        if answer != b"OK":\n', "        if not answer:\n"),),
    ),
    Fresh(
        "a driver that was closed cannot be opened again",
        "after a lost connection the device comes back only with a new daemon",
        (
            (
                "        writer, self._writer = self._writer, None\n",
                "        writer = self._writer\n",
            ),
        ),
    ),
    Fresh(
        "a row is emitted after the pause",
        "each row is recorded one interval after it was measured, up to 1 s",
        (
            (
                _LOOP + _SLEEP,
                _LOOP.splitlines(keepends=True)[0] + _SLEEP + _LOOP.splitlines(keepends=True)[1],
            ),
        ),
    ),
)
