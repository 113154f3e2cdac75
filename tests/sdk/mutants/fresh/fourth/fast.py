"""Mistakes in a drive on UDP."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "a setpoint that stays is sent every 0.42 s only",
        "a drive whose watchdog acts after 0.3 to 0.4 s switches off while it runs steadily",
        (
            (
                "        self._sequence = 0\n        self._flags = 0\n",
                "        self._sequence = 0\n        self._sent = (0.0, 0.0)\n"
                "        self._flags = 0\n",
            ),
            (
                "        self._send(min(max(speed, -fastest), fastest))\n",
                "        speed = min(max(speed, -fastest), fastest)\n"
                "        now_s = time.monotonic()\n"
                "        if speed == self._sent[0] and now_s - self._sent[1] < 0.42:\n"
                "            return  # well within its 0.5 s\n"
                "        self._sent = speed, now_s\n"
                "        self._send(speed)\n",
            ),
        ),
    ),
    Fresh(
        "arming goes on with the last setpoint",
        "after a stop, arming moves the axis at the speed of the run before",
        (
            (
                "        self._sequence = 0\n        self._flags = 0\n",
                "        self._sequence = 0\n        self._speed = 0.0\n        self._flags = 0\n",
            ),
            (
                "        self._flags = protocol.ENABLE\n        self._send(0.0)\n",
                "        self._flags = protocol.ENABLE\n        self._send(self._speed)\n",
            ),
            (
                "        self._send(min(max(speed, -fastest), fastest))\n",
                "        self._speed = min(max(speed, -fastest), fastest)\n"
                "        self._send(self._speed)\n",
            ),
        ),
    ),
    Fresh(
        "one new reply is taken in a cycle",
        "after a stall replies queue up: from then on each row is as old as the stall was long",
        (
            (
                "                newest = reply\n                self._answered = reply.sequence\n",
                "                newest = reply\n                self._answered = reply.sequence\n"
                "                break\n",
            ),
        ),
    ),
    Fresh(
        "a switch-off that could not be sent is forgotten",
        "if the network fails as it is made safe, the next command enables the drive again",
        (
            (
                "        self._flags = 0\n        self._enabled = False\n"
                "        if self._socket is not None:\n            self._send(0.0)\n",
                "        self._enabled = False\n        if self._socket is not None:\n"
                "            self._send(0.0, 0)\n        self._flags = 0\n",
            ),
            (
                "    def _send(self, speed: float) -> None:\n",
                "    def _send(self, speed: float, flags: int | None = None) -> None:\n"
                "        flags = self._flags if flags is None else flags\n",
            ),
            (
                "protocol.command(self._sequence, self._flags, speed)",
                "protocol.command(self._sequence, flags, speed)",
            ),
        ),
    ),
    Fresh(
        "replies from before arm() are told by a lower number",
        "armed as the counter nears 255, the drive is not ready for up to 256 cycles",
        (("(newest.sequence - self._arming) % 256 >= 128", "newest.sequence < self._arming"),),
    ),
    Fresh(
        "the watchdog is proved with the drive switched on",
        "the drive has power before anybody has armed it, while a person mounts the sample",
        (
            (
                "        self._exchange()\n        time.sleep(2 * WATCHDOG_S)\n",
                "        self._flags = protocol.ENABLE  # it acts only then\n"
                "        self._exchange()\n        self._flags = 0\n"
                "        time.sleep(2 * WATCHDOG_S)\n",
            ),
        ),
        allowed="a proof may enable a drive at zero, as those of the CANopen drives do",
    ),
    Fresh(
        "the position is extrapolated to the cycle",
        "positions are computed, not measured: at each reversal they overshoot the travel",
        (
            (
                "CLSRow.of(position=newest.position, ",
                "CLSRow.of(position=newest.position + 0.005 * newest.speed, ",
            ),
        ),
    ),
    Fresh(
        "commands leave from one fixed UDP port",
        "after a kill the process that rescues cannot open: the drive is not switched off",
        (
            (
                "            self._socket.connect((host, port))\n",
                '            self._socket.bind(("", 16707))  # the firewall lets it pass\n'
                "            self._socket.connect((host, port))\n",
            ),
        ),
    ),
    Fresh(
        "an answer to arm() makes it ready",
        "a drive that is locked counts as ready: the run begins and nothing moves",
        (
            (
                "        return self._enabled\n",
                "        return bool(self._flags) and self._arming is None\n",
            ),
        ),
    ),
    Fresh(
        "rows carry the time of day",
        "rows are stamped decades after the others: no signal can be set beside another",
        (
            (
                "        return CLSRow.of(position",
                "        self.taken_ns = time.time_ns()\n        return CLSRow.of(position",
            ),
        ),
    ),
    Fresh(
        "a thread repeats the setpoint while it is armed",
        "if the cycle hangs, the thread feeds the watchdog: the axis runs on into its stop",
        (
            ("import math\nimport socket\n", "import math\nimport socket\nimport threading\n"),
            (
                "        self._sequence = 0\n        self._flags = 0\n",
                "        self._sequence = 0\n        self._speed = 0.0\n        self._flags = 0\n",
            ),
            (
                "        self._arming = self._sequence\n",
                "        self._arming = self._sequence\n"
                "        self._speed = 0.0\n"
                "        threading.Thread(target=self._repeat, daemon=True).start()\n",
            ),
            (
                "        self._send(min(max(speed, -fastest), fastest))\n",
                "        self._speed = min(max(speed, -fastest), fastest)\n"
                "        self._send(self._speed)\n",
            ),
            (
                "    def _receive(self) -> bytes | None:\n",
                "    def _repeat(self) -> None:\n"
                '        """Bridge cycles that come late."""\n'
                "        while self._flags and self._socket is not None:\n"
                "            time.sleep(0.1)\n"
                "            try:\n"
                "                if self._flags:\n"
                "                    self._send(self._speed)\n"
                "            except LinkError:\n"
                "                return\n\n"
                "    def _receive(self) -> bytes | None:\n",
            ),
        ),
    ),
    Fresh(
        "at setpoint zero the drive is switched off",
        "in a dwell the axis is not held: the load pushes it away, and each start enables anew",
        (
            (
                "        self._sequence = 0\n        self._flags = 0\n",
                "        self._sequence = 0\n        self._armed = False\n"
                "        self._flags = 0\n",
            ),
            (
                "        self._arming = self._sequence\n",
                "        self._arming = self._sequence\n        self._armed = True\n",
            ),
            (
                "        fastest = self.config.speed_range\n        self._send(",
                "        fastest = self.config.speed_range\n"
                "        if self._armed and self._arming is None:\n"
                "            self._flags = protocol.ENABLE if speed else 0  # it gets hot at rest\n"
                "        self._send(",
            ),
            (
                "        self._flags = 0\n        self._enabled = False\n        if self._socket",
                "        self._flags = 0\n        self._enabled = self._armed = False\n"
                "        if self._socket",
            ),
            (
                "        self._flags, self._enabled = 0, False  # the next",
                "        self._flags, self._enabled, self._armed = 0, False, False  # the next",
            ),
        ),
    ),
)
