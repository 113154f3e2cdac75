"""Mistakes in a thermometer on TCP."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_KELVIN = '    return float(match["celsius"]) + ICE_POINT_K\n'

MUTANTS = (
    Fresh(
        "hundredths are added below zero as well",
        "-23.45 C is read as -22.55 C; above zero all is right",
        (
            (
                _KELVIN,
                '    whole, hundredths = match["celsius"].split(b".")\n'
                "    return int(whole) + int(hundredths) / 100 + ICE_POINT_K\n",
            ),
        ),
        "protocol",
    ),
    Fresh(
        "the interval of the rig file is not used",
        "with interval 10 ms there are 10 readings in a second, not 100",
        (
            (
                "            await asyncio.sleep(self.config.interval)\n",
                "            await asyncio.sleep(0.1)\n",
            ),
        ),
    ),
    Fresh(
        "any answer to the zero counts as done",
        "the device refuses with E1, the operator reads 'zero set'",
        (('        if answer != b"OK":\n', "        if not answer:\n"),),
    ),
    Fresh(
        "each exchange takes a lock of its own",
        "the operator presses zero in a run: two wait for one answer, and the run ends",
        (("        async with self._exchange:\n", "        async with asyncio.Lock():\n"),),
    ),
    Fresh(
        "a reading that fails is asked for again, without end",
        "a pulled cable is never an error, and after a late answer every reading is one too old",
        (
            (
                "            kelvin = protocol.parse_reading(await self._ask(protocol.ASK))\n",
                "            try:\n"
                "                kelvin = protocol.parse_reading(await self._ask(protocol.ASK))\n"
                "            except DeviceError:\n"
                "                await asyncio.sleep(self.config.interval)\n"
                "                continue\n",
            ),
        ),
    ),
    Fresh(
        "the identity is shown, not checked",
        "another device at the address is opened as this thermometer",
        (
            (
                "protocol.parse_identity(await self._ask(protocol.IDENTIFY))",
                "(await self._ask(protocol.IDENTIFY)).decode()",
            ),
        ),
    ),
    Fresh(
        "the ice point is taken for the triple point",
        "every temperature is 0.01 K too high, one digit of the device",
        (("ICE_POINT_K: Final = 273.15\n", "ICE_POINT_K: Final = 273.16\n"),),
        "protocol",
    ),
    Fresh(
        "silent after two default intervals",
        "with interval 1 s, which is permitted, a sound thermometer counts as failed",
        (("            silent_s=2.0,\n", "            silent_s=0.2,\n"),),
    ),
)
