"""Mistakes in a drive on UDP: setpoints, life, watchdog, data, resources."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_WRITE = "        self._send(min(max(speed, -fastest), fastest))\n"
_ANSWERED = "        self._answered: int | None = None  # sequence of the newest reply\n"
_NONE = "        if newest is None:\n            return None\n"
_ROW = (
    "        return CLSRow.of(position=newest.position, speed=newest.speed, status=newest.status)\n"
)

MUTANTS = (
    Fresh(
        "small setpoints are taken as zero",
        "a test at 5 mm/s: the axis stands still, the procedure believes that it creeps",
        (
            (
                _WRITE,
                "        if abs(speed) < 0.01:\n            speed = 0.0\n" + _WRITE,
            ),
        ),
    ),
    Fresh(
        "setpoints are rounded to 0.1 m/s",
        "a setpoint of 0.14 m/s moves the axis at 0.1 m/s",
        ((_WRITE, "        speed = round(speed, 1)\n" + _WRITE),),
    ),
    Fresh(
        "setpoints are clipped to the default range",
        "with speed_range 5 m/s the rig file permits 5 m/s, the drive gets 1 m/s at most",
        (
            (
                "        fastest = self.config.speed_range\n        self._send",
                "        fastest = 1.0\n        self._send",
            ),
        ),
    ),
    Fresh(
        "the declared range is the largest that the drive knows",
        "rigd accepts limits of 10 m/s on a drive that is set to 1 m/s: the axis does not follow",
        (("        fastest = config.speed_range\n", "        fastest = 10.0\n"),),
    ),
    Fresh(
        "reverse is clipped to rest",
        "a negative setpoint stops the axis",
        ((_WRITE, "        self._send(min(max(speed, 0.0), fastest))\n"),),
    ),
    Fresh(
        "a setpoint is sent only if it has changed",
        "at constant speed the drive hears nothing, and its watchdog switches it off in the run",
        (
            (_ANSWERED, _ANSWERED + "        self._sent: float | None = None\n"),
            (
                _WRITE,
                "        if speed == self._sent:\n            return\n"
                "        self._sent = speed\n" + _WRITE,
            ),
        ),
    ),
    Fresh(
        "a ramp of the driver goes on after make_safe",
        "after the next arm the axis starts near its last speed, although the rig orders rest",
        (
            (_ANSWERED, _ANSWERED + "        self._ramped = 0.0\n"),
            (
                _WRITE,
                "        self._ramped += min(max(speed - self._ramped, -0.05), 0.05)\n"
                "        self._send(min(max(self._ramped, -fastest), fastest))\n",
            ),
        ),
    ),
    Fresh(
        "arm sends the last setpoint",
        "the axis jumps to the setpoint that was written last, before the rig orders it",
        (
            (_ANSWERED, _ANSWERED + "        self._speed = 0.0\n"),
            (
                "        self._flags = protocol.ENABLE\n        self._send(0.0)\n",
                "        self._flags = protocol.ENABLE\n        self._send(self._speed)\n",
            ),
            (
                _WRITE,
                "        self._speed = min(max(speed, -fastest), fastest)\n"
                "        self._send(self._speed)\n",
            ),
        ),
    ),
    Fresh(
        "write sends the setpoint of the cycle before",
        "each setpoint arrives one cycle late, the last one never",
        (
            (_ANSWERED, _ANSWERED + "        self._next = 0.0\n"),
            (
                _WRITE,
                "        due, self._next = self._next, min(max(speed, -fastest), fastest)\n"
                "        self._send(due)\n",
            ),
        ),
    ),
    Fresh(
        "NaN is ignored without a word",
        "a profile computes NaN: the axis runs on, and nobody learns of it until the watchdog acts",
        (
            (
                "            raise DeviceError(\"setpoint 'speed' is NaN, expected m/s\")\n",
                "            return\n",
            ),
        ),
    ),
    Fresh(
        "make_safe switches off for one command only",
        "the next write after make_safe enables the drive again",
        (
            (
                "        self._flags = 0\n        self._enabled = False\n"
                "        if self._socket is not None:\n            self._send(0.0)\n",
                "        self._enabled = False\n"
                "        if self._socket is not None:\n"
                "            flags, self._flags = self._flags, 0\n"
                "            self._send(0.0)\n"
                "            self._flags = flags\n",
            ),
        ),
    ),
    Fresh(
        "make_safe sends nothing before the drive is ready",
        "a stop between arm and the first reply leaves the drive enabled until its watchdog acts",
        (
            (
                "        self._flags = 0\n        self._enabled = False\n"
                "        if self._socket is not None:\n            self._send(0.0)\n",
                "        enabled, self._enabled = self._enabled, False\n"
                "        self._flags = 0\n"
                "        if self._socket is not None and enabled:\n            self._send(0.0)\n",
            ),
        ),
    ),
    Fresh(
        "make_safe leaves ready true",
        "armed again at once, the driver reports a drive as enabled that has not answered yet",
        (
            (
                "        self._flags = 0\n        self._enabled = False\n        if",
                "        self._flags = 0\n        if",
            ),
        ),
    ),
    Fresh(
        "make_safe waits for the reply",
        "a drive that does not answer delays the stop of all other devices by 0.6 s",
        (
            (
                "        if self._socket is not None:\n            self._send(0.0)\n",
                "        if self._socket is not None:\n            self._exchange()\n",
            ),
        ),
    ),
    Fresh(
        "arm waits until the drive has answered",
        "with a slow answer the cycle stands still for up to 0.6 s",
        (
            (
                "        self._flags = protocol.ENABLE\n        self._send(0.0)\n",
                "        self._flags = protocol.ENABLE\n        self._exchange()\n",
            ),
        ),
    ),
    Fresh(
        "any reply is taken for the answer",
        "confirm_safe and the proof of the watchdog trust a reply to an earlier command",
        (
            (
                "                if reply is not None and reply.sequence == self._sequence:\n",
                "                if reply is not None:\n",
            ),
        ),
    ),
    Fresh(
        "a reply counts only if its number is greater",
        "after number 255 there are no more rows",
        (
            (
                "reply is not None and reply.sequence != self._answered:",
                "reply is not None and reply.sequence > (self._answered or 0):",
            ),
        ),
    ),
    Fresh(
        "five missing rows are bridged with the last",
        "old values are recorded as new; interlocks see a fresh speed of an axis that is not heard",
        (
            (
                _ANSWERED,
                _ANSWERED + "        self._row: CLSRow | None = None\n        self._missed = 0\n",
            ),
            (
                _NONE,
                "        if newest is None:\n"
                "            self._missed += 1\n"
                "            return self._row if self._missed <= 5 else None\n"
                "        self._missed = 0\n",
            ),
            (
                _ROW,
                _ROW.replace("return", "self._row =") + "        return self._row\n",
            ),
        ),
    ),
    Fresh(
        "a missing position is extrapolated",
        "the recording has positions that no encoder has measured",
        (
            (
                _ANSWERED,
                _ANSWERED
                + "        self._last: protocol.Reply | None = None\n"
                + "        self._read_ns = 0\n",
            ),
            (
                _NONE,
                "        if newest is None:\n"
                "            last, self._last = self._last, None\n"
                "            if last is None:\n"
                "                return None\n"
                "            ahead = last.position + last.speed * (t_ns - self._read_ns) * 1e-9\n"
                "            return CLSRow.of(position=ahead, speed=last.speed, "
                "status=last.status)\n"
                "        self._last, self._read_ns = newest, t_ns\n",
            ),
        ),
    ),
    Fresh(
        "one reply is read in a cycle",
        "after a stall of the network every row stays old by as many cycles as replies wait",
        (
            (
                "                self._answered = reply.sequence\n        if",
                "                self._answered = reply.sequence\n"
                "                break\n        if",
            ),
        ),
    ),
    Fresh(
        "read takes all that comes",
        "a flood of frames keeps the cycle in read",
        (("        for _ in range(MOST_FRAMES):\n", "        while True:\n"),),
    ),
    Fresh(
        "the status is that of the row before",
        "each row says whether the drive was enabled a cycle ago: a trip is recorded late",
        (
            (_ANSWERED, _ANSWERED + "        self._status = 0\n"),
            (
                _ROW,
                "        before, self._status = self._status, newest.status\n"
                + _ROW.replace("status=newest.status", "status=before"),
            ),
        ),
    ),
    Fresh(
        "the speed has no sign",
        "motion in reverse is recorded as forward",
        ((_ROW, _ROW.replace("speed=newest.speed", "speed=abs(newest.speed)")),),
    ),
    Fresh(
        "the speed is computed for a cycle of 1 ms",
        "with other cycle times, and after each missing row, the recorded speed is wrong",
        (
            (_ANSWERED, _ANSWERED + "        self._position: float | None = None\n"),
            (
                _ROW,
                "        before = newest.position if self._position is None else self._position\n"
                "        self._position = newest.position\n"
                "        speed = (newest.position - before) / 1e-3\n"
                + _ROW.replace("speed=newest.speed", "speed=speed"),
            ),
        ),
    ),
    Fresh(
        "the position begins at zero",
        "the axis stands at -0.25 m, the recording says 0: limits of travel act at another place",
        (
            (_ANSWERED, _ANSWERED + "        self._zero: float | None = None\n"),
            (
                _ROW,
                "        if self._zero is None:\n            self._zero = newest.position\n"
                + _ROW.replace("newest.position", "newest.position - self._zero"),
            ),
        ),
    ),
    Fresh(
        "the proof returns the figure of the manual",
        "the report gives 0.5 s as measured, whatever the drive took",
        (("        return tripped_ms * 1e-3\n", "        return WATCHDOG_S\n"),),
    ),
    Fresh(
        "the proof leaves the drive enabled",
        "the proof energises the drive; afterwards each write has the flag that enables it",
        (
            (
                "        self._exchange()\n        time.sleep(2 * WATCHDOG_S)\n",
                "        self._flags = protocol.ENABLE\n"
                "        self._exchange()\n        time.sleep(2 * WATCHDOG_S)\n",
            ),
        ),
    ),
    Fresh(
        "a thread feeds the watchdog",
        "the cycle hangs: the thread repeats the last setpoint, and the axis runs on for ever",
        (
            ("import socket\n", "import socket\nimport threading\n"),
            (
                _ANSWERED,
                _ANSWERED
                + "        self._speed = 0.0\n"
                + "        self._quiet = False\n"
                + "        self._ends = threading.Event()\n"
                + "        self._thread: threading.Thread | None = None\n",
            ),
            (
                '        self.identity = f"speed drive at {host}:{port}"\n',
                '        self.identity = f"speed drive at {host}:{port}"\n'
                "        self._ends.clear()\n"
                "        self._thread = threading.Thread(target=self._feed, daemon=True)\n"
                "        self._thread.start()\n\n"
                "    def _feed(self) -> None:\n"
                "        while not self._ends.wait(0.1):\n"
                "            if self._flags and not self._quiet:\n"
                "                try:\n"
                "                    self._send(self._speed)\n"
                "                except LinkError:\n"
                "                    return\n",
            ),
            (
                _WRITE,
                "        self._speed = min(max(speed, -fastest), fastest)\n"
                "        self._send(self._speed)\n",
            ),
            (
                "        link, self._socket = self._socket, None\n",
                "        self._ends.set()\n"
                "        if self._thread is not None:\n"
                "            self._thread.join()\n"
                "            self._thread = None\n"
                "        link, self._socket = self._socket, None\n",
            ),
        ),
    ),
    Fresh(
        "preflight tries to enable the drive",
        "the question whether the rig can be armed energises the drive",
        (
            (
                "    def arm(self) -> None:\n",
                "    def preflight(self) -> Sequence[str]:\n"
                "        self._flags = protocol.ENABLE\n"
                "        enabled = self._exchange().status & protocol.ENABLED\n"
                "        self.make_safe()\n"
                "        return [] if enabled else ['the drive cannot be enabled']\n\n"
                "    def arm(self) -> None:\n",
            ),
        ),
    ),
    Fresh(
        "the rescue does not look at the drive",
        "the rescue of a drive that does not switch off passes for a success",
        (
            (
                "            self.open()\n            self.confirm_safe()\n",
                "            self.open()\n            self.make_safe()\n",
            ),
        ),
    ),
    Fresh(
        "the rescue leaves its socket open",
        "each rescue leaves a socket in the process that does it",
        (
            (
                "        try:\n            self.open()\n            self.confirm_safe()\n"
                "        finally:\n            self.close()\n",
                "        self.open()\n        self.confirm_safe()\n",
            ),
        ),
    ),
    Fresh(
        "the host of the rig file is ignored",
        "the rig file names a drive in the hall, the driver moves the one on this computer",
        (
            (
                "        host, port = self.config.host, self.config.port\n",
                '        host, port = "127.0.0.1", self.config.port\n',
            ),
        ),
    ),
    Fresh(
        "confirm_safe takes no answer for a yes",
        "a drive that cannot be reached any more counts as switched off",
        (
            ("import math\n", "import contextlib\nimport math\n"),
            (
                "        if self._socket is not None and self._exchange(SAFE_TRIES).status & "
                "protocol.ENABLED:\n"
                "            raise DeviceError(\n"
                '                "the drive is still enabled after the command to switch off",\n'
                '                hint="switch off its supply",\n'
                "            )\n",
                "        enabled = 0\n"
                "        with contextlib.suppress(LinkError):\n"
                "            enabled = self._exchange(SAFE_TRIES).status & protocol.ENABLED\n"
                "        if enabled:\n"
                '            raise DeviceError("it is still enabled", hint="pull its plug")\n',
            ),
        ),
    ),
    Fresh(
        "read waits 5 ms for the reply",
        "each cycle without a reply takes 5 ms longer: at 1 kHz the rig misses four cycles",
        (
            (
                "        self._socket.setblocking(False)\n",
                "        self._socket.settimeout(0.005)\n",
            ),
            (
                "        except BlockingIOError:\n            return None\n",
                "        except (BlockingIOError, TimeoutError):\n            return None\n",
            ),
        ),
    ),
    Fresh(
        "the driver keeps all replies",
        "a rig that runs for days grows until the machine has no memory",
        (
            (_ANSWERED, _ANSWERED + "        self._log: list[protocol.Reply] = []\n"),
            (_NONE, _NONE + "        self._log.append(newest)\n"),
        ),
    ),
    Fresh(
        "a reply that is too long is unpacked",
        "a disturbed frame ends the run with an error of Python's struct, without device or advice",
        (
            (
                "    if len(frame) != _REPLY.size + _CRC.size:\n",
                "    if len(frame) < _REPLY.size + _CRC.size:\n",
            ),
        ),
        "protocol",
    ),
)
