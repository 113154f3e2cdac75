"""Mistakes in a sensor that the cycle asks."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_FORCE = "            force=raw * NEWTONS_PER_COUNT,\n"
_ANSWERED = "        self._answered: int | None = None\n"

MUTANTS = (
    Fresh(
        "a force at the end of its range is the last one before it",
        "in an overload the force stays at a harmless value: no interlock stops the run",
        (
            (_ANSWERED, _ANSWERED + "        self._force = 0.0\n"),
            (
                "        return CLSRow.of(\n",
                "        if not status & 1:  # else it is not valid\n"
                "            self._force = raw * NEWTONS_PER_COUNT\n"
                "        return CLSRow.of(\n",
            ),
            (_FORCE, "            force=self._force,\n"),
        ),
    ),
    Fresh(
        "counts are added up from differences of 16 bits",
        "after 33 mm between two answers the position is wrong by 65 mm for the rest of the day",
        (
            (
                _ANSWERED,
                _ANSWERED + "        self._counts: int | None = None  # not wrapped\n",
            ),
            (
                "        return CLSRow.of(\n",
                "        if self._counts is None:\n"
                "            self._counts = counts\n"
                "        self._counts += (counts - self._counts + 32768) % 65536 - 32768\n"
                "        counts = self._counts\n"
                "        return CLSRow.of(\n",
            ),
        ),
    ),
    Fresh(
        "it is asked again only after an answer",
        "one datagram that is lost silences the sensor until rigd starts anew",
        (
            (_ANSWERED, _ANSWERED + "        self._asked = False\n"),
            (
                "        self._send()\n        if newest is None:\n",
                "        if newest is not None or not self._asked:\n"
                "            self._send()\n"
                "            self._asked = True\n"
                "        if newest is None:\n",
            ),
        ),
    ),
    Fresh(
        "a position without reference is given as zero",
        "the slider is shown at zero wherever it is: limits of travel do not act",
        (
            (
                "            position=counts * self.config.resolution,\n",
                "            position=counts * self.config.resolution if status & 2 else 0.0,\n",
            ),
        ),
    ),
    Fresh(
        "the force is the median of three answers",
        "a peak of one answer is never seen, and each step of the force comes an answer late",
        (
            (_ANSWERED, _ANSWERED + "        self._raws: list[int] = []\n"),
            (
                "        return CLSRow.of(\n",
                "        self._raws = [*self._raws[-2:], raw]\n"
                "        raw = sorted(self._raws)[len(self._raws) // 2]\n"
                "        return CLSRow.of(\n",
            ),
        ),
    ),
    Fresh(
        "the position is that of the answer before",
        "force and position are of two instants: a hysteresis is recorded that is not there",
        (
            (_ANSWERED, _ANSWERED + "        self._before: int | None = None\n"),
            (
                "        return CLSRow.of(\n",
                "        before, self._before = self._before, counts\n"
                "        counts = counts if before is None else before\n"
                "        return CLSRow.of(\n",
            ),
        ),
    ),
    Fresh(
        "a jump of the position is thrown away as disturbed",
        "after a gap in the network each answer is a jump from the last good one: no row any more",
        (
            (_ANSWERED, _ANSWERED + "        self._good: int | None = None\n"),
            (
                "        return CLSRow.of(\n",
                "        if self._good is not None and abs(counts - self._good) > 2000:\n"
                "            return None\n"
                "        self._good = counts\n"
                "        return CLSRow.of(\n",
            ),
        ),
    ),
    Fresh(
        "bits are declared by their number",
        "a procedure that waits for the reference begins on the overload, and never sees one",
        (('{"force_at_rail": 1, "referenced": 2}', '{"force_at_rail": 0, "referenced": 1}'),),
    ),
)
