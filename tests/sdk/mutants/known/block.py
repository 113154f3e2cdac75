"""Mistakes in the block driver of `support.written_drivers`."""

from __future__ import annotations

from sdk.mutants.known import Mutant

_VOLTS = "counts * VOLTS_PER_COUNT"
_GAP = "            if packet.first != self._expected:\n"
_BLOCK = "        return Block(times_ns, volts[:, np.newaxis])\n"
_PERIOD = "        period_ns = 1e9 / self.rate_hz\n"
_HEADER = '            if head != b"AP" or not 0 < count <= MOST_SAMPLES:\n'
_NONE = "            except TimeoutError:\n                return None\n"
_LOST = "            if not data:\n                raise self._lost(None)\n"
_CLOSE = "            link.close()\n"
_START = "            self._start_ns = time.monotonic_ns()"
_CONST = "        self._expected = 0\n        try:\n"

MUTANTS = (
    # times
    Mutant(
        "wall clock", "any order of calls", _START, "            self._start_ns = time.time_ns()"
    ),
    Mutant(
        "period of another rate",
        "any order of calls",
        _PERIOD,
        "        period_ns = 2e9 / self.rate_hz\n",
    ),
    Mutant(
        "rate of another card",
        "any order of calls",
        'float(match["rate"])\n',
        '2.0 * float(match["rate"])\n',
        "protocol",
    ),
    Mutant(
        "times in the future",
        "any order of calls",
        _START,
        _START + " + 2_000_000_000",
    ),
    Mutant(
        "times of long ago",
        "any order of calls",
        _START,
        _START + " - 20_000_000_000",
    ),
    Mutant(
        "one time for a block",
        "any order of calls",
        _BLOCK,
        "        times_ns[:] = times_ns[-1]\n" + _BLOCK,
    ),
    # values
    Mutant("in millivolts", "any order of calls", _VOLTS, "1e3 * " + _VOLTS, "protocol"),
    Mutant("sign inverted", "any order of calls", _VOLTS, "-" + _VOLTS, "protocol"),
    Mutant("scale of 5 V", "any order of calls", _VOLTS, "0.5 * " + _VOLTS, "protocol"),
    Mutant("bytes swapped", "any order of calls", '"<i2"', '">i2"', "protocol"),
    Mutant(
        "single precision",
        "any order of calls",
        _BLOCK,
        "        return Block(times_ns, volts[:, np.newaxis].astype(np.float32))\n",
    ),
    Mutant("flat array", "any order of calls", _BLOCK, "        return Block(times_ns, volts)\n"),
    Mutant(
        "newest row without values",
        "any order of calls",
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
        "                return self._block([protocol.Packet(self._expected, volts)])\n",
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
        "any order of calls",
        "        deadline = time.monotonic() + timeout_s\n",
        "        time.sleep(1.5)\n        deadline = time.monotonic() + timeout_s\n",
    ),
    Mutant(
        "start forgotten",
        "any order of calls",
        "            self._opened().sendall(protocol.START)\n",
        "            self._opened()\n",
    ),
    Mutant(
        "close leaves the stream on",
        "any order of calls",
        _CLOSE,
        "            self._kept = link\n",
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
    # in some orders of calls alone
    Mutant(
        "numbers go on over a new start",
        "any order of calls",
        _CONST,
        "        try:\n",
    ),
    Mutant(
        "clock of the first start",
        "any order of calls",
        _START,
        "            self._start_ns = self._start_ns or time.monotonic_ns()",
    ),
    Mutant(
        "last packet kept back",
        "any order of calls",
        "            packets = self._packets.feed(data)\n",
        "            packets = [*getattr(self, '_late', []), *self._packets.feed(data)]\n"
        "            self._late, packets = packets[-1:], packets[:-1]\n",
    ),
    Mutant("voltage without sign", "any order of calls", _VOLTS, "abs(" + _VOLTS + ")", "protocol"),
    Mutant(
        "voltage of half the range",
        "any order of calls",
        _BLOCK,
        "        volts = np.clip(volts, -5.0, 5.0)\n" + _BLOCK,
    ),
    Mutant("offset of 0.5 V", "any order of calls", _VOLTS, _VOLTS + " + 0.5", "protocol"),
    Mutant(
        "every second row",
        "any order of calls",
        _BLOCK,
        "        return Block(times_ns[::2], volts[::2, np.newaxis])\n",
    ),
    Mutant(
        "rows in mid-packet dropped after a pause",
        "any order of calls",
        _BLOCK,
        "        if len(volts) > 100:\n            times_ns, volts = times_ns[-50:], volts[-50:]\n"
        + _BLOCK,
    ),
    Mutant(
        "values of the first packet",
        "any order of calls",
        _BLOCK,
        "        self._first = getattr(self, '_first', volts[0])\n        volts[:] = self._first\n"
        + _BLOCK,
    ),
    Mutant(
        "times run backwards in a block",
        "any order of calls",
        _BLOCK,
        "        return Block(times_ns[::-1], volts[:, np.newaxis])\n",
    ),
    Mutant("socket dropped", "any order of calls", _CLOSE, "            pass\n"),
    Mutant(
        "socket left after a wrong greeting",
        "garbled at open",
        "        except BaseException:\n            self.close()\n            raise\n",
        "        except BaseException:\n            self._kept, self._socket = self._socket, None\n"
        "            raise\n",
    ),
    Mutant(
        "constructor connects",
        "constructor opens nothing",
        "        self._start_ns = 0  #",
        "        socket.create_connection((config.host, config.port), 1.0).close()\n"
        "        self._start_ns = 0  #",
    ),
    Mutant(
        "opens once",
        "any order of calls",
        _CLOSE,
        _CLOSE + "            self._socket = link\n",
    ),
    Mutant(
        "own time-out",
        "silent",
        "            link.settimeout(left)\n",
        "            link.settimeout(left + 1.0)\n",
    ),
    Mutant(
        "waits for two packets",
        "any order of calls",
        "            packets = self._packets.feed(data)\n            if packets:\n",
        "            self._late = [*getattr(self, '_late', []), *self._packets.feed(data)]\n"
        "            if len(self._late) > 1:\n"
        "                packets, self._late = self._late, []\n",
    ),
)
