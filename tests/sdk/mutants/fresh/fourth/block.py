"""Mistakes in a data acquisition card."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_BLOCK = "        return Block(times_ns, volts[:, np.newaxis])\n"
_EXPECTED = "        self._expected = 0  # number of the next sample\n"

MUTANTS = (
    Fresh(
        "half a packet of the connection before is kept",
        "after a cable was pulled the card cannot be started: its first packet is no packet",
        (
            (
                "        self._packets = protocol.PacketBuffer()\n        self._expected = 0\n"
                "        try:\n",
                "        self._expected = 0\n        try:\n",
            ),
        ),
    ),
    Fresh(
        "packets are collected for the whole time that it may wait",
        "the cycle sees each row as late as the wait was long: an interlock acts late by that",
        (
            (
                "        deadline = time.monotonic() + timeout_s\n",
                "        deadline = time.monotonic() + timeout_s\n"
                "        found: list[protocol.Packet] = []\n",
            ),
            (
                "                return None\n            except OSError",
                "                break\n            except OSError",
            ),
            (
                "            packets = self._packets.feed(data)\n            if packets:\n"
                "                return self._block(packets)\n        return None\n",
                "            found += self._packets.feed(data)\n"
                "        return self._block(found) if found else None\n",
            ),
        ),
    ),
    Fresh(
        "the time between samples is in whole milliseconds",
        "at 2 kHz all rows have the same time; at 300 Hz they are a tenth too fast",
        (
            (
                "        period_ns = 1e9 / self.rate_hz\n",
                "        period_ns = round(1e3 / self.rate_hz) * 1_000_000\n",
            ),
        ),
    ),
    Fresh(
        "times are set to the clock once a packet is read late",
        "after a stall of the computer all rows are stamped later by its length",
        (
            (
                _BLOCK,
                "        late_ns = time.monotonic_ns() - int(times_ns[-1])\n"
                "        if late_ns > 100_000_000:  # the clock of the card drifts\n"
                "            self._start_ns += late_ns\n" + _BLOCK,
            ),
        ),
    ),
    Fresh(
        "close() waits until the card has ended its stream",
        "the card streams on: at the end of each run rigd hangs for 5 s",
        (
            (
                "        if link is not None:\n            link.close()\n",
                "        if link is not None:\n"
                "            deadline = time.monotonic() + 5.0\n"
                "            try:\n"
                "                link.settimeout(0.5)\n"
                "                link.shutdown(socket.SHUT_WR)\n"
                "                while time.monotonic() < deadline and link.recv(READ_BYTES):\n"
                "                    pass\n"
                "            except OSError:\n"
                "                pass\n"
                "            finally:\n"
                "                link.close()\n",
            ),
        ),
    ),
    Fresh(
        "the cycle sees the first row of a block",
        "interlocks and end conditions act on a value that is a block, up to 60 ms, old",
        (
            (
                "    def close(self) -> None:\n",
                "    def newest_row(self, block: Block) -> list[float]:\n"
                '        """Return the row for the cycle."""\n'
                "        row: list[float] = block.values[0].tolist()\n"
                "        return row\n\n"
                "    def close(self) -> None:\n",
            ),
        ),
    ),
    Fresh(
        "bytes that begin no packet are passed over",
        "a card that sends nonsense gives neither rows nor an error",
        (
            (
                '            if head != b"AP" or not 0 < count <= MOST_SAMPLES:\n'
                "                raise ProtocolError(\n"
                '                    f"expected a packet, got {bytes(self._bytes[:8])!r}",\n'
                '                    hint="bytes were lost: check the cable, and start again",\n'
                "                )\n",
                '            if head != b"AP" or not 0 < count <= MOST_SAMPLES:\n'
                "                del self._bytes[:1]\n"
                "                continue\n",
            ),
        ),
        file="protocol",
        allowed="damaged packets may be thrown away: rigd names a device of which no row comes "
        "for silent_s, here 1 s",
    ),
    Fresh(
        "a block is a view of one buffer",
        "rows that were handed over change as the next block comes: the file has others",
        (
            (_EXPECTED, _EXPECTED + "        self._volts = np.empty((65536, 1))\n"),
            (
                "        volts = np.concatenate([packet.volts for packet in packets])\n",
                "        count = len(numbers)\n"
                "        rows = np.concatenate([packet.volts for packet in packets])\n"
                "        self._volts[:count, 0] = rows\n",
            ),
            (_BLOCK, "        return Block(times_ns, self._volts[:count])\n"),
        ),
    ),
    Fresh(
        "the start is the full second",
        "all rows are stamped up to 1 s too early, differently in each recording",
        (
            (
                "self._start_ns = time.monotonic_ns()  # before",
                "self._start_ns = int(time.monotonic()) * 1_000_000_000  # before",
            ),
        ),
    ),
    Fresh(
        "every block is kept",
        "a campaign over night fills the memory: the recording ends in the middle",
        (
            (_EXPECTED, _EXPECTED + "        self._blocks: list[Block] = []\n"),
            (
                _BLOCK,
                "        self._blocks.append(Block(times_ns, volts[:, np.newaxis]))\n"
                "        return self._blocks[-1]\n",
            ),
        ),
    ),
    Fresh(
        "a voltage below 0.1 V at the start is subtracted as offset",
        "a small load that is on the sensor from the start on is measured as none",
        (
            (_EXPECTED, _EXPECTED + "        self._offset: float | None = None\n"),
            (
                _BLOCK,
                "        if first == 0:\n"
                "            mean = float(volts.mean())\n"
                "            self._offset = mean if abs(mean) < 0.1 else 0.0\n"
                "        return Block(times_ns, (volts - (self._offset or 0.0))[:, np.newaxis])\n",
            ),
        ),
    ),
)
