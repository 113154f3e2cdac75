"""Mistakes in a data acquisition card."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "times are computed in 32 bits",
        "after 2.1 s the times of the rows jump back by 4.3 s, and again every 4.3 s",
        (
            ("period_ns = 1e9 / self.rate_hz", "period_ns = round(1e9 / self.rate_hz)"),
            (
                "numbers = np.arange(first, self._expected) + 1",
                "numbers = np.arange(first, self._expected, dtype=np.int32) + np.int32(1)",
            ),
            (
                "times_ns = self._start_ns + np.rint(numbers * period_ns).astype(np.int64)",
                "times_ns = np.int64(self._start_ns) + numbers * np.int32(period_ns)",
            ),
        ),
    ),
    Fresh(
        "the card samples from open on",
        "rows are stamped too late by the time from open to start, the first ones in the future",
        (
            (
                "            self.identity, self.rate_hz = protocol.parse_greeting(greeting)\n",
                "            self.identity, self.rate_hz = protocol.parse_greeting(greeting)\n"
                "            self._socket.sendall(protocol.START)\n",
            ),
            (
                "            self._opened().sendall(protocol.START)\n",
                "            self._opened()\n",
            ),
        ),
    ),
    Fresh(
        "waits a second, whatever it is told",
        "a card that is silent holds its process: stop and close are heard a second late",
        (("            link.settimeout(left)\n", "            link.settimeout(1.0)\n"),),
    ),
    Fresh(
        "blocks are handed over two packets at a time",
        "interlocks see the voltage 50 ms later than need be; the last packet of a run is lost",
        (
            (
                "        self._start_ns = 0  # when",
                "        self._kept: list[protocol.Packet] = []\n"
                "        self._start_ns = 0  # when",
            ),
            (
                "        self._expected = 0\n        try:\n",
                "        self._expected = 0\n        self._kept = []\n        try:\n",
            ),
            (
                "            packets = self._packets.feed(data)\n            if packets:\n",
                "            self._kept += self._packets.feed(data)\n"
                "            if len(self._kept) > 1:\n"
                "                packets, self._kept = self._kept, []\n",
            ),
        ),
    ),
    Fresh(
        "samples near the end of the range are no numbers",
        "an input that is overloaded shows nothing, when a limit on it should act",
        (
            (
                "        return Block(times_ns, volts[:, np.newaxis])\n",
                "        volts[np.abs(volts) > 9.95] = np.nan  # overload\n"
                "        return Block(times_ns, volts[:, np.newaxis])\n",
            ),
        ),
    ),
    Fresh(
        "the bytes of all buffers are one array",
        "opened again after a stop within a packet, the card 'sends no packet'",
        (
            (
                "    def __init__(self) -> None:\n        self._bytes = bytearray()\n",
                "    _bytes = bytearray()\n",
            ),
        ),
        file="protocol",
    ),
    Fresh(
        "one packet is taken out for each arrival",
        "after one stall of the computer all rows stay behind, by as much as was waiting then",
        (
            (
                "        while len(self._bytes) >= _HEADER.size:\n",
                "        if len(self._bytes) >= _HEADER.size:\n",
            ),
            ("                break\n", "                return packets\n"),
        ),
        file="protocol",
    ),
    Fresh(
        "the clock begins with the arrival of the first packet",
        "if the machine is late to read at the start, all rows of the run are as late",
        (
            (
                "        period_ns = 1e9 / self.rate_hz\n",
                "        period_ns = 1e9 / self.rate_hz\n"
                "        if first == 0:\n"
                "            now_ns = time.monotonic_ns()\n"
                "            self._start_ns = now_ns - round(self._expected * period_ns)\n",
            ),
        ),
    ),
)
