"""Mistakes in a card that hands over blocks of samples."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_BLOCK = "    def _block(self, packets: list[protocol.Packet]) -> Block:\n"
_LOST = (
    "                raise DeviceError(\n"
    '                    f"samples were lost: expected number {self._expected}, '
    'got {packet.first}",\n'
    '                    hint="the machine or the network is too slow: lower the rate",\n'
    "                )\n"
)

MUTANTS = (
    Fresh(
        "time begins when the first packet arrives",
        "every row is recorded 50 ms after it was taken, the last of a block in the future",
        (
            (
                "        first = self._expected\n",
                "        first = self._expected\n"
                "        if first == 0:\n"
                "            self._start_ns = time.monotonic_ns()\n",
            ),
        ),
    ),
    Fresh(
        "lost samples are filled with the next one",
        "the recording has voltages that the card has not measured, and says nothing",
        (
            (
                _LOST + "            self._expected += len(packet.volts)\n",
                "                lost = packet.first - self._expected\n"
                "                filled.append(np.full(max(lost, 0), packet.volts[0]))\n"
                "            filled.append(packet.volts)\n"
                "            self._expected = packet.first + len(packet.volts)\n",
            ),
            (
                "        first = self._expected\n",
                "        first = self._expected\n        filled = []\n",
            ),
            (
                "np.concatenate([packet.volts for packet in packets])",
                "np.concatenate(filled)[: self._expected - first]",
            ),
        ),
    ),
    Fresh(
        "a packet with an old number counts as new",
        "a card that repeats a packet gives new rows with old voltages",
        (
            (
                "            if packet.first != self._expected:\n",
                "            if packet.first > self._expected:\n",
            ),
        ),
    ),
    Fresh(
        "start goes on with the number of the last time",
        "a card that was closed and opened again reports samples as lost",
        (
            (
                "        self._packets = protocol.PacketBuffer()\n"
                "        self._expected = 0\n        try:\n",
                "        self._packets = protocol.PacketBuffer()\n        try:\n",
            ),
        ),
    ),
    Fresh(
        "of several packets the last one counts",
        "after each stall of the machine rows that have arrived are missing, and nothing says so",
        (
            (
                "            packets = self._packets.feed(data)\n",
                "            packets = self._packets.feed(data)[-1:]\n",
            ),
            (_LOST, "                self._expected = packet.first\n"),
            (
                "        numbers = np.arange(first, self._expected) + 1\n",
                "        numbers = np.arange(packets[0].first, self._expected) + 1\n",
            ),
        ),
    ),
    Fresh(
        "rows of a call that ends early are thrown away",
        "a call waits for 200 rows; those of a call that ends before are lost",
        (
            (
                "        deadline = time.monotonic() + timeout_s\n",
                "        deadline = time.monotonic() + timeout_s\n"
                "        collected: list[protocol.Packet] = []\n",
            ),
            (
                "            packets = self._packets.feed(data)\n            if packets:\n"
                "                return self._block(packets)\n",
                "            collected += self._packets.feed(data)\n"
                "            if sum(len(each.volts) for each in collected) >= 200:\n"
                "                return self._block(collected)\n",
            ),
        ),
    ),
    Fresh(
        "close shuts the connection down and keeps its socket",
        "each open and close leaves a socket in the process",
        (
            ("import socket\n", "import contextlib\nimport socket\n"),
            (
                "            link.close()\n",
                "            self._old = (getattr(self, '_old', ()), link)\n"
                "            with contextlib.suppress(OSError):\n"
                "                link.shutdown(socket.SHUT_RDWR)\n",
            ),
        ),
    ),
    Fresh(
        "all blocks share their memory",
        "a block that waits to be recorded gets the voltages of the next one",
        (
            (
                "        self._expected = 0  # number of the next sample\n",
                "        self._expected = 0  # number of the next sample\n"
                "        self._volts = np.empty((65536, 1))\n",
            ),
            (
                "        return Block(times_ns, volts[:, np.newaxis])\n",
                "        self._volts[: len(volts), 0] = volts\n"
                "        return Block(times_ns, self._volts[: len(volts)])\n",
            ),
        ),
    ),
    Fresh(
        "a closed connection is no rows yet",
        "a card that has gone is not reported, the helper turns without a pause",
        (
            (
                "            if not data:\n                raise self._lost(None)\n",
                "            if not data:\n                return None\n",
            ),
        ),
    ),
    Fresh(
        "the cycle sees the first row of a block",
        "interlocks act on a voltage that is as old as a block is long",
        (
            (
                _BLOCK,
                "    def newest_row(self, block: Block) -> list[float]:\n"
                "        row: list[float] = block.values[0].tolist()\n"
                "        return row\n\n" + _BLOCK,
            ),
        ),
    ),
)
