"""Mistakes in a sensor that the cycle asks."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "asked again only once the last question is answered",
        "after one datagram that was lost no reading comes to the end of the run",
        (
            (
                "        self._answered: int | None = None\n",
                "        self._answered: int | None = None\n        self._waits = False\n",
            ),
            (
                "        self._send()\n        if newest is None:\n",
                "        if newest is not None or not self._waits:\n"
                "            self._send()\n"
                "            self._waits = True\n"
                "        if newest is None:\n",
            ),
        ),
    ),
    Fresh(
        "position is rounded to whole mm",
        "an encoder of 1 um shows steps of 1 mm: no slip before sliding can be seen",
        (
            (
                "position=counts * self.config.resolution",
                "position=round(counts * self.config.resolution, 3)",
            ),
        ),
    ),
    Fresh(
        "force at the end of its range is not a number",
        "an overload shows as no force: the limit on the force does not act when it is needed",
        (
            (
                "force=raw * NEWTONS_PER_COUNT",
                'force=float("nan") if status & 1 else raw * NEWTONS_PER_COUNT',
            ),
        ),
    ),
    Fresh(
        "a lost connection is opened anew in the cycle",
        "a sensor without supply is never reported, and each cycle leaves a socket to be collected",
        (
            (
                "            return None\n"
                "        except OSError as error:\n"
                "            raise self._lost(error) from error\n",
                "            return None\n"
                "        except OSError:\n"
                "            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)\n"
                "            self._socket.setblocking(False)\n"
                "            self._socket.connect((self.config.host, self.config.port))\n"
                "            return None\n",
            ),
        ),
    ),
    Fresh(
        "the last row is held for five cycles",
        "readings that nobody took are recorded: position stands still while the slider moves",
        (
            (
                "        self._answered: int | None = None\n",
                "        self._answered: int | None = None\n"
                "        self._held: tuple[int, int, int, int] | None = None\n"
                "        self._left = 0\n",
            ),
            (
                "        if newest is None:\n            return None\n        _, status",
                "        if newest is not None:\n"
                "            self._held, self._left = newest, 5\n"
                "        elif self._held is not None and self._left > 0:\n"
                "            newest, self._left = self._held, self._left - 1\n"
                "        if newest is None:\n"
                "            return None\n"
                "        _, status",
            ),
        ),
    ),
    Fresh(
        "the socket keeps a timeout of 10 ms",
        "each cycle of the rig waits 10 ms after the last answer: 1 kHz becomes less than 100 Hz",
        (
            ("self._socket.setblocking(False)", "self._socket.settimeout(0.01)"),
            (
                "        except BlockingIOError:\n            return None\n",
                "        except TimeoutError:\n            return None\n",
            ),
        ),
    ),
    Fresh(
        "force is read without its sign",
        "a pull of 1 N shows as a push of 81 N",
        (('struct.Struct("<cBBih")', 'struct.Struct("<cBBiH")'),),
    ),
    Fresh(
        "only the answer to the last question counts",
        "a sensor that needs more than one cycle for its answer gives no row at all",
        (
            (
                "if reply is not None and reply[0] != self._answered:",
                "if reply is not None and reply[0] == self._sequence != self._answered:",
            ),
        ),
    ),
)
