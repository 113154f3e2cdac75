"""Mistakes in a thermometer on a serial port."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_PORT = "        self._port = LinePort(config)\n"
_ZERO = "            answer = await self._port.ask(protocol.ZERO, lambda line: line, REPLY_S)\n"

MUTANTS = (
    Fresh(
        "the time to give up counts from the begin of the run",
        "one answer that is disturbed ends each run that is older than 3 s",
        (
            (
                "            if kelvin is not None:\n                heard_s = loop.time()\n",
                "            if kelvin is not None:\n",
            ),
        ),
    ),
    Fresh(
        "a zero without an answer counts as set",
        "the cable is out, the person reads zero set, and the run goes on with the old zero",
        (
            (
                '        if answer != b"OK":\n',
                '        if answer is not None and answer != b"OK":\n',
            ),
        ),
    ),
    Fresh(
        "only the name of the port is taken from the rig file",
        "a device set to 115200 baud is never heard, whatever the rig file says",
        ((_PORT, "        self._port = LinePort(PortConfig(port=config.port))\n"),),
    ),
    Fresh(
        "instances of one port share it",
        "a second look at the port, which is refused, closes it for the run that goes on",
        (
            (
                "GIVE_UP_S: Final = 3.0\n",
                "GIVE_UP_S: Final = 3.0\n_PORTS: dict[str, LinePort] = {}\n",
            ),
            (_PORT, "        self._port = _PORTS.setdefault(config.port, LinePort(config))\n"),
        ),
    ),
    Fresh(
        "0 °C is taken for the triple point",
        "all temperatures are 0.01 K too high: by the last digit that the device shows",
        (("ICE_POINT_K: Final = 273.15", "ICE_POINT_K: Final = 273.16"),),
        file="protocol",
    ),
    Fresh(
        "a port that is gone is waited for",
        "the adapter is pulled out, and the run goes on for ever without a reading or an error",
        (
            (
                "            kelvin = await self._reading()\n",
                "            try:\n"
                "                kelvin = await self._reading()\n"
                "            except (DeviceError, LinkError):\n"
                "                self._port.close()\n"
                "                await asyncio.sleep(0.5)\n"
                "                with contextlib.suppress(LinkError):\n"
                "                    await self._port.open(again=True)\n"
                "                kelvin, heard_s = None, loop.time()\n",
            ),
            ("import asyncio\n", "import asyncio\nimport contextlib\n"),
        ),
    ),
    Fresh(
        "answers are waited for 50 ms",
        "a device that needs 60 ms is never heard, although its manual allows it 0.5 s",
        (("REPLY_S: Final = 0.5\n", "REPLY_S: Final = 0.05\n"),),
    ),
    Fresh(
        "lines are at most 12 bytes long",
        "a device with a serial number of six characters is said not to answer",
        ((_PORT, "        self._port = LinePort(config, max_line=12)\n"),),
    ),
    Fresh(
        "an answer that does not come is recorded as not a number",
        "means and interlocks over it become not a number: a limit that is passed does not act",
        (
            (
                "            elif loop.time() - heard_s > GIVE_UP_S:\n",
                "            else:\n"
                '                emit(CLSRow.of(temperature=float("nan")))\n'
                "            if loop.time() - heard_s > GIVE_UP_S:\n",
            ),
        ),
    ),
    Fresh(
        "after a zero the port is kept for 4 s",
        "for 4 s after a zero there are no readings: an interlock takes the device for dead",
        ((_ZERO, _ZERO + "            await asyncio.sleep(4.0)  # the sensor settles\n"),),
    ),
)
