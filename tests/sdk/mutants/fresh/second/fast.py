"""Mistakes in a drive on UDP."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "replies must have a greater number than the last",
        "after number 255 no reply counts any more: the axis is lost a moment after the start",
        (
            (
                "reply.sequence != self._answered:  # else it is seen already",
                "(self._answered is None or reply.sequence > self._answered):",
            ),
        ),
    ),
    Fresh(
        "the proof returns the time of the manual",
        "the report of the rig shows 0.5 s, though the drive was measured to take another time",
        (("        return tripped_ms * 1e-3\n", "        return WATCHDOG_S\n"),),
    ),
    Fresh(
        "setpoints are clipped on one side only",
        "a setpoint far below the range goes to the drive as it is: full speed in reverse",
        (
            (
                "self._send(min(max(speed, -fastest), fastest))",
                "self._send(min(speed, fastest))",
            ),
        ),
    ),
    Fresh(
        "ready once arm is answered, enabled or not",
        "a drive that its key switch locks counts as armed: the trial runs on an axis at rest",
        (("        return self._enabled\n", "        return self._arming is None\n"),),
    ),
    Fresh(
        "a refused connection counts as no reply",
        "a drive without supply is never reported as lost, only as silent, with the wrong hint",
        (
            (
                "            return self._opened().recv(FRAME_BYTES)\n"
                "        except BlockingIOError:\n",
                "            return self._opened().recv(FRAME_BYTES)\n"
                "        except (BlockingIOError, ConnectionRefusedError):\n",
            ),
        ),
    ),
    Fresh(
        "late replies are told by number, without its wrap",
        "armed just after number 255, a late reply from the run before makes the drive ready;"
        " armed just before, it is not ready for 250 cycles if one reply is lost",
        (
            (
                "(newest.sequence - self._arming) % 256 >= 128:",
                "newest.sequence < self._arming:",
            ),
        ),
    ),
    Fresh(
        "the trip is looked at after the new state",
        "the watchdog switches the drive off in a run: no error, the trial goes on at rest",
        (
            (
                "        if self._enabled and newest.status & protocol.TRIPPED:\n",
                "        self._enabled = bool(newest.status & protocol.ENABLED)\n"
                "        if self._enabled and newest.status & protocol.TRIPPED:\n",
            ),
        ),
    ),
    Fresh(
        "one frame is received per cycle",
        "after a stall of 50 ms positions are 50 cycles old for the rest of the run",
        (("MOST_FRAMES: Final = 16\n", "MOST_FRAMES: Final = 1\n"),),
    ),
    Fresh(
        "the setpoint is declared from zero",
        "no procedure can move the axis in reverse: every setpoint below 0 is refused",
        (('"speed of the axis", -fastest, fastest),', '"speed of the axis", 0.0, fastest),'),),
    ),
    Fresh(
        "rescue takes a drive that does not answer as off",
        "after a kill the rig says that the drive is safe; nobody has reached it",
        (
            (
                "            self.confirm_safe()\n        finally:\n",
                "            self.confirm_safe()\n"
                "        except LinkError:\n"
                "            pass  # nothing there that could move\n"
                "        finally:\n",
            ),
        ),
    ),
    Fresh(
        "the status is recorded without the bit of the watchdog",
        "a recording does not show that the watchdog had acted, only that the drive was off",
        (
            (
                "speed=newest.speed, status=newest.status)",
                "speed=newest.speed, status=int(self._enabled))",
            ),
        ),
    ),
    Fresh(
        "any reply answers the question",
        "a reply from before make_safe says 'enabled': a false alarm that the drive is still on",
        (
            (
                "if reply is not None and reply.sequence == self._sequence:",
                "if reply is not None:",
            ),
        ),
    ),
)
