"""Mistakes in a thermometer on TCP."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_LOOP = (
    "        while True:\n"
    "            kelvin = protocol.parse_reading(await self._ask(protocol.ASK))\n"
    "            emit(CLSRow.of(temperature=kelvin))\n"
    "            await asyncio.sleep(self.config.interval)\n"
)

MUTANTS = (
    Fresh(
        "a serial number has digits only",
        "a device with a letter on its plate is refused as another make",
        ((r'rb"ACME-T (?P<serial>\w+)"', r'rb"ACME-T (?P<serial>\d+)"'),),
        file="protocol",
    ),
    Fresh(
        "an interval below 0.1 s is 0.1 s",
        "a fast warming is recorded at 10 readings per second, where the rig file says 50",
        (
            (
                "asyncio.sleep(self.config.interval)",
                "asyncio.sleep(max(self.config.interval, 0.1))",
            ),
        ),
    ),
    Fresh(
        "readings near the last one are left out for up to 1.5 s",
        "a slow drift is recorded as stairs, and an interlock on it acts up to 1.5 s late",
        (
            (
                _LOOP,
                "        loop = asyncio.get_running_loop()\n"
                "        last, last_s = 0.0, 0.0\n"
                "        while True:\n"
                "            kelvin = protocol.parse_reading(await self._ask(protocol.ASK))\n"
                "            if abs(kelvin - last) > 0.05 or loop.time() - last_s > 1.5:\n"
                "                last, last_s = kelvin, loop.time()\n"
                "                emit(CLSRow.of(temperature=kelvin))\n"
                "            await asyncio.sleep(self.config.interval)\n",
            ),
        ),
    ),
    Fresh(
        "the sign is taken from the whole degrees",
        "between -1 °C and 0 °C the sign is lost: melting ice that warms seems to cool",
        (
            (
                '    return float(match["celsius"]) + ICE_POINT_K\n',
                '    whole, _, hundredths = match["celsius"].partition(b".")\n'
                "    degrees = int(whole)\n"
                "    part = int(hundredths) / 100\n"
                "    return degrees + (part if degrees >= 0 else -part) + ICE_POINT_K\n",
            ),
        ),
        file="protocol",
    ),
    Fresh(
        "only answers that begin with E refuse",
        "a device that is busy does not set its zero: the run goes on with the old one",
        (('        if answer != b"OK":\n', '        if answer.startswith(b"E"):\n'),),
    ),
    Fresh(
        "the zero is set once more if no answer comes",
        "a device that answers late sets its zero twice, the second time as the run has begun",
        (
            (
                "        answer = await self._ask(protocol.ZERO)\n",
                "        try:\n"
                "            answer = await self._ask(protocol.ZERO)\n"
                "        except DeviceError:\n"
                "            answer = await self._ask(protocol.ZERO)\n",
            ),
        ),
    ),
    Fresh(
        "a connection that is lost is made anew within the run",
        "after a power cut the sensor has lost its zero; the run goes on, and nobody is told",
        (
            (
                "            kelvin = protocol.parse_reading(await self._ask(protocol.ASK))\n",
                "            try:\n"
                "                answer = await self._ask(protocol.ASK)\n"
                "            except DeviceError:\n"
                "                await self.close()\n"
                "                await self.open()\n"
                "                continue\n"
                "            kelvin = protocol.parse_reading(answer)\n",
            ),
        ),
    ),
    Fresh(
        "a reading is handed over as the next is asked for",
        "each row is stamped an interval, up to 1 s, after it was measured",
        (
            (
                _LOOP,
                "        answer = await self._ask(protocol.ASK)\n"
                "        while True:\n"
                "            await asyncio.sleep(self.config.interval)\n"
                "            emit(CLSRow.of(temperature=protocol.parse_reading(answer)))\n"
                "            answer = await self._ask(protocol.ASK)\n",
            ),
        ),
    ),
    Fresh(
        "all thermometers share one lock",
        "one that does not answer holds up the readings of all others of the rig",
        (
            (
                '    title: ClassVar[str] = "',
                "    _exchange: ClassVar[asyncio.Lock] = asyncio.Lock()\n"
                '    title: ClassVar[str] = "',
            ),
            ("        self._exchange = asyncio.Lock()  # run and act share the connection\n", ""),
        ),
    ),
    Fresh(
        "up to three answers that do not come are bridged",
        "for 1.5 s after the device has failed its last temperature is recorded as measured",
        (
            (
                _LOOP,
                "        kelvin, missed = 0.0, 0\n"
                "        while True:\n"
                "            try:\n"
                "                kelvin = protocol.parse_reading(await self._ask(protocol.ASK))\n"
                "                missed = 0\n"
                "            except DeviceError:\n"
                "                missed += 1\n"
                "                if missed > 3 or not kelvin:\n"
                "                    raise\n"
                "            emit(CLSRow.of(temperature=kelvin))\n"
                "            await asyncio.sleep(self.config.interval)\n",
            ),
        ),
    ),
    Fresh(
        "a device that does not tell its identity is taken",
        "a port behind which nothing answers is opened as if the device were there",
        (
            (
                "            self.identity = protocol.parse_identity("
                "await self._ask(protocol.IDENTIFY))\n",
                "            self.identity = protocol.parse_identity("
                "await self._ask(protocol.IDENTIFY))\n"
                "        except DeviceError:  # old ones do not know the question\n"
                '            self.identity = "ACME-T"\n',
            ),
        ),
    ),
)
