"""Mistakes in a card that streams blocks."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "sample n is stamped n periods after the start",
        "all rows are stamped one period early, beside the other devices of the rig",
        (
            (
                "numbers = np.arange(first, self._expected) + 1\n",
                "numbers = np.arange(first, self._expected)\n",
            ),
        ),
    ),
    Fresh(
        "the number of the next sample is kept over a restart",
        "the second start reports samples as lost at once",
        (
            (
                "        self._packets = protocol.PacketBuffer()\n        self._expected = 0\n",
                "        self._packets = protocol.PacketBuffer()\n",
            ),
        ),
    ),
    Fresh(
        "only samples that come twice are an error",
        "after lost samples no error, and all rows from there on are stamped too early",
        (
            (
                "            if packet.first != self._expected:",
                "            if packet.first < self._expected:",
            ),
        ),
    ),
    Fresh(
        "the timeout of the connection stays",
        "a silent card holds its process for 3 s: the stop of the rig waits for it",
        (("            link.settimeout(left)\n", ""),),
    ),
    Fresh(
        "a closed connection counts as no data",
        "a card that is switched off is asked without pause and never reported as gone",
        (
            (
                "            if not data:\n                raise self._lost(None)\n",
                "            if not data:\n                return None\n",
            ),
        ),
    ),
    Fresh(
        "counts are scaled in 16 bits",
        "right below 1 V, wrong above: 16-bit integers overflow",
        (("Packet(first, counts * VOLTS_PER_COUNT)", "Packet(first, counts * 10 / 32768)"),),
        "protocol",
    ),
    Fresh(
        "the rate is that of the manual",
        "a card that is set to 500 Hz is stamped at 1 kHz: its rows take half the time",
        (
            (
                "self.rate_hz = protocol.parse_greeting(greeting)\n",
                "self.rate_hz = protocol.parse_greeting(greeting)[0], 1000.0\n",
            ),
        ),
    ),
    Fresh(
        "the first start gives the time for all",
        "after a second start all rows are stamped in the past, by the time since the first",
        (
            (
                "            self._start_ns = time.monotonic_ns()  #",
                "            self._start_ns = self._start_ns or time.monotonic_ns()  #",
            ),
        ),
    ),
)
