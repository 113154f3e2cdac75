"""Mistakes in a sensor that the cycle asks (`sensor/driver.py`)."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_NONE = "        if newest is None:\n            return None\n"

MUTANTS = (
    Fresh(
        "read asks and waits for the answer",
        "a sensor that does not answer takes 20 ms of each cycle",
        (
            (
                "        newest = None\n",
                "        newest = None\n        self._send()\n"
                "        readable(self._opened(), 0.02)\n",
            ),
            ("        self._send()\n        if newest is None:", "        if newest is None:"),
        ),
    ),
    Fresh(
        "a missing answer is the last row once more",
        "the recording has new rows of a sensor that gives no answer",
        (
            (
                "        self._answered: int | None = None\n",
                "        self._answered: int | None = None\n"
                "        self._row: tuple[int, int, int, int] | None = None\n",
            ),
            (
                _NONE,
                "        newest = newest or self._row\n" + _NONE + "        self._row = newest\n",
            ),
        ),
    ),
    Fresh(
        "the number of an answer is not looked at",
        "a sensor that repeats an answer gives new rows with old values",
        (
            (
                "            if reply is not None and reply[0] != self._answered:\n",
                "            if reply is not None:\n",
            ),
        ),
    ),
    Fresh(
        "one answer is read in a cycle",
        "after a stall every row stays old by as many cycles as answers wait",
        (
            (
                "                self._answered = reply[0]\n",
                "                self._answered = reply[0]\n                break\n",
            ),
        ),
    ),
    Fresh(
        "the status has the reference alone",
        "a load cell at the end of its range is recorded as a good force",
        (("            status=status,\n", "            status=status & 2,\n"),),
    ),
    Fresh(
        "counts have no sign",
        "a slider at -0.15 m is recorded at 4294 m",
        (('struct.Struct("<cBBih")', 'struct.Struct("<cBBIh")'),),
    ),
    Fresh(
        "the resolution of the rig file is ignored",
        "an encoder of 5 um per count gives a fifth of its travel",
        (("counts * self.config.resolution", "counts * 1e-6"),),
    ),
    Fresh(
        "open drops its socket if nothing answers",
        "each try to open a sensor that is switched off leaves a socket that nobody closes",
        (
            (
                "            self.close()\n            raise LinkError(",
                "            self._socket = None\n            raise LinkError(",
            ),
        ),
    ),
    Fresh(
        "a lost connection is no answer",
        "a sensor that has gone is never reported, its rows only grow old",
        (
            (
                "        except BlockingIOError:\n            return None\n"
                "        except OSError as error:\n"
                "            raise self._lost(error) from error\n",
                "        except OSError:\n            return None\n",
            ),
            (
                "        except OSError as error:\n"
                "            raise self._lost(error) from error\n\n"
                "    def _receive",
                "        except OSError:\n            return\n\n    def _receive",
            ),
        ),
    ),
    Fresh(
        "make_safe sends to a sensor that may not be open",
        "a rig that stops before the sensor is open gets an error from its stop",
        (
            (
                '        """Do nothing: it only measures."""\n\n    def close',
                '        """Ask for no more."""\n        self._send()\n\n    def close',
            ),
        ),
    ),
    Fresh(
        "a second open replaces the socket",
        "the socket of the first is left behind, and two drivers ask one sensor",
        (
            (
                "        if self._socket is not None:\n"
                '            raise LinkError(f"{where} is open already", hint="close it first")\n',
                "",
            ),
        ),
    ),
)
