"""Mistakes in the block driver that `rigd new driver --kind block` writes."""

from __future__ import annotations

from support.mutants import Mutant

_VOLTS = "counts * VOLTS_PER_COUNT"
_GAP = "            if packet.first != self._expected:\n"
_BLOCK = "        return Block(times_ns, volts[:, np.newaxis])\n"
_PERIOD = "        period_ns = 1e9 / self.rate_hz\n"
_HEADER = '            if head != b"AP" or not 0 < count <= MOST_SAMPLES:\n'
_NONE = "            except TimeoutError:\n                return None\n"
_LOST = "            if not data:\n                raise self._lost(None)\n"
_CLOSE = "            link.close()\n"
_ARRIVED = "self._block(packets, time.monotonic_ns())"

MUTANTS = (
    # times
    Mutant("wall clock", "blocks", _ARRIVED, "self._block(packets, time.time_ns())"),
    Mutant(
        "period of another rate",
        "times are true",
        _PERIOD,
        "        period_ns = 2e9 / self.rate_hz\n",
    ),
    Mutant(
        "rate of another card",
        "times are true",
        'float(match["rate"])\n',
        '2.0 * float(match["rate"])\n',
        "protocol",
    ),
    Mutant(
        "times in the future",
        "times are true",
        _ARRIVED,
        "self._block(packets, time.monotonic_ns() + 2_000_000_000)",
    ),
    Mutant(
        "times of long ago",
        "times are true",
        _ARRIVED,
        "self._block(packets, time.monotonic_ns() - 20_000_000_000)",
    ),
    Mutant(
        "one time for a block",
        "blocks",
        _BLOCK,
        "        times_ns[:] = arrived_ns\n" + _BLOCK,
    ),
    # values
    Mutant("in millivolts", "blocks", _VOLTS, "1e3 * " + _VOLTS, "protocol"),
    Mutant("sign inverted", "rows are true", _VOLTS, "-" + _VOLTS, "protocol"),
    Mutant("scale of 5 V", "rows are true", _VOLTS, "0.5 * " + _VOLTS, "protocol"),
    Mutant("bytes swapped", "rows are true", '"<i2"', '">i2"', "protocol"),
    Mutant(
        "single precision",
        "blocks",
        _BLOCK,
        "        return Block(times_ns, volts[:, np.newaxis].astype(np.float32))\n",
    ),
    Mutant("flat array", "blocks", _BLOCK, "        return Block(times_ns, volts)\n"),
    Mutant(
        "newest row without values",
        "newest row",
        "    def _opened(self)",
        "    def newest_row(self, block: Block) -> list[float]:\n        return []\n\n"
        "    def _opened(self)",
    ),
    # losses
    Mutant("lost samples ignored", "lossy", _GAP, "            if False:\n"),
    Mutant(
        "same packet again",
        "frozen",
        _GAP,
        "            if packet.first > self._expected:\n",
    ),
    Mutant(
        "damaged packet taken",
        "garbled",
        _HEADER,
        "            if not 0 < count <= MOST_SAMPLES:\n",
        "protocol",
    ),
    Mutant(
        "last block in silence",
        "silent",
        _NONE,
        "            except TimeoutError:\n"
        "                first, self._expected = self._expected, self._expected + 50\n"
        "                volts = np.zeros(50)\n"
        "                return self._block([protocol.Packet(self._expected, volts)], 0)\n",
    ),
    Mutant(
        "end of stream taken for silence",
        "dead",
        _LOST,
        "            if not data:\n                return None\n",
    ),
    Mutant(
        "bare OSError",
        "dead",
        "            except OSError as error:\n                raise self._lost(error) from error\n"
        "            if not data:\n                raise self._lost(None)\n",
        '            if not data:\n                raise OSError("it closed")\n',
    ),
    # calls
    Mutant(
        "time-out ignored",
        "silent",
        "        deadline = time.monotonic() + timeout_s\n",
        "        deadline = time.monotonic() + 1000.0\n",
    ),
    Mutant(
        "sleeps before it reads",
        "time-out",
        "        deadline = time.monotonic() + timeout_s\n",
        "        time.sleep(1.5)\n        deadline = time.monotonic() + timeout_s\n",
    ),
    Mutant(
        "start forgotten",
        "blocks",
        "            self._opened().sendall(protocol.START)\n",
        "            self._opened()\n",
    ),
    Mutant(
        "close leaves the stream on", "quiet after close", _CLOSE, "            self._kept = link\n"
    ),
    Mutant(
        "no hint",
        "not there",
        '                hint="check its supply, its cable and the address",\n',
        "",
    ),
    Mutant(
        "greeting not understood",
        "garbled at open",
        "    match = _GREETING.fullmatch(line)\n",
        '    line.decode("ascii")\n    match = _GREETING.fullmatch(line)\n',
        "protocol",
    ),
)
