"""Mistakes in a drive on UDP."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "a trip while switched off ends the run",
        "opened half a second before the others, the drive is said to have failed: no run begins",
        (("if self._enabled and newest.status & ", "if newest.status & "),),
    ),
    Fresh(
        "setpoints are rounded to cm/s",
        "a creep at 4 mm/s does not move the axis, one at 6 mm/s moves it at 10 mm/s",
        (
            (
                "self._send(min(max(speed, -fastest), fastest))",
                "self._send(round(min(max(speed, -fastest), fastest), 2))",
            ),
        ),
    ),
    Fresh(
        "position counts from where the drive was opened",
        "limits of travel are elsewhere after each start: the carriage runs into its stop",
        (
            (
                "        self._sequence = 0\n        self._flags = 0\n",
                "        self._sequence = 0\n"
                "        self._flags = 0\n"
                "        self._home: float | None = None\n",
            ),
            (
                "        return CLSRow.of(position=newest.position,",
                "        if self._home is None:\n"
                "            self._home = newest.position\n"
                "        return CLSRow.of(position=newest.position - self._home,",
            ),
        ),
    ),
    Fresh(
        "only a drive that has reported enabled is switched off",
        "stopped right after arm, before the first reply, the drive stays on until its watchdog",
        (
            (
                "        self._flags = 0\n"
                "        self._enabled = False\n"
                "        if self._socket is not None:\n",
                "        was, self._flags, self._enabled = self._enabled, 0, False\n"
                "        if self._socket is not None and was:\n",
            ),
        ),
    ),
    Fresh(
        "the port of this computer is fixed",
        "a second drive of the kind does not open; nor does the rescue beside a daemon that hangs",
        (
            (
                "            self._socket.connect((host, port))\n",
                '            self._socket.bind(("", 21_005))  # the drive answers to it\n'
                "            self._socket.connect((host, port))\n",
            ),
        ),
    ),
    Fresh(
        "close switches the drive off first",
        "with the cable out close raises and keeps the socket: it cannot be opened again",
        (
            (
                "        link, self._socket = self._socket, None\n",
                "        self.make_safe()\n        link, self._socket = self._socket, None\n",
            ),
        ),
    ),
    Fresh(
        "confirm_safe asks the driver's own memory",
        "a drive with a welded relay goes on, and the stop is reported as confirmed",
        (
            (
                "if self._socket is not None and self._exchange(SAFE_TRIES).status"
                " & protocol.ENABLED:",
                "if self._socket is not None and self._enabled:",
            ),
        ),
    ),
    Fresh(
        "an axis at rest gives no rows",
        "an axis that waits for its next trial counts as silent, and the run is ended",
        (
            (
                "        self._sequence = 0\n        self._flags = 0\n",
                "        self._sequence = 0\n"
                "        self._flags = 0\n"
                "        self._position = math.inf\n",
            ),
            (
                "        return CLSRow.of(",
                "        if newest.position == self._position:\n"
                "            return None  # seen already\n"
                "        self._position = newest.position\n"
                "        return CLSRow.of(",
            ),
        ),
    ),
    Fresh(
        "a rescue that fails stays open",
        "the second try of the rescue says that the drive is open already, and sends nothing",
        (
            (
                "        try:\n"
                "            self.open()\n"
                "            self.confirm_safe()\n"
                "        finally:\n"
                "            self.close()\n",
                "        self.open()\n        self.confirm_safe()\n        self.close()\n",
            ),
        ),
    ),
    Fresh(
        "read waits for the reply to the last command",
        "while the drive is silent each cycle takes 50 ms: all axes of the rig are served late",
        (
            (
                "        newest = None\n        for _ in range(MOST_FRAMES):\n",
                "        newest = None\n"
                "        readable(self._opened(), 0.05)\n"
                "        for _ in range(MOST_FRAMES):\n",
            ),
        ),
    ),
    Fresh(
        "the speed of a row is the speed asked for",
        "an axis that is blocked, or switched off, is recorded as turning",
        (
            (
                "        self._sequence = 0\n        self._flags = 0\n",
                "        self._sequence = 0\n        self._flags = 0\n        self._speed = 0.0\n",
            ),
            (
                "        self._sequence = (self._sequence + 1) % 256\n",
                "        self._sequence = (self._sequence + 1) % 256\n"
                "        self._speed = speed\n",
            ),
            ("speed=newest.speed, status", "speed=self._speed, status"),
        ),
    ),
    Fresh(
        "enabled and tripped at once counts as off",
        "a drive whose relay is welded has tripped as well: the rescue reports that it is safe",
        (
            (
                "self._exchange(SAFE_TRIES).status & protocol.ENABLED:",
                "self._exchange(SAFE_TRIES).status == protocol.ENABLED:",
            ),
        ),
    ),
)
