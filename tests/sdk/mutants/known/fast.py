"""Mistakes in the fast driver that `rigd new driver --kind fast` writes."""

from __future__ import annotations

from sdk.mutants.known import Mutant

_OPENED = '        self.identity = f"speed drive at {host}:{port}"\n'
_SEND_ZERO = "        if self._socket is not None:\n            self._send(0.0)\n"
_CLIPPED = "self._send(min(max(speed, -fastest), fastest))"
_PROOF = """\
        time.sleep(2 * WATCHDOG_S)
        tripped_ms = self._exchange().tripped_ms
"""
_THREAD = """
        import threading

        def keep() -> None:
            while self._socket is not None:
                self._send(self._last)
                time.sleep(0.05)

        threading.Thread(target=keep, daemon=True).start()
"""
_NO_ROW = "        if newest is None:\n            return None\n"
_READY = "        return self._enabled\n"
_FRESH = "reply is not None and reply.sequence != self._answered"
_CONFIRM = """\
        if self._socket is not None and self._exchange(SAFE_TRIES).status & protocol.ENABLED:
"""
_RESCUE = "            self.open()\n            self.confirm_safe()\n"
_CRC = '    if head != b"AR" or _CRC.unpack(frame[_REPLY.size :]) != (zlib.crc32(body),):\n'
_TRIPPED = "        if self._enabled and newest.status & protocol.TRIPPED:\n"

MUTANTS = (
    # open and arm
    Mutant(
        "open moves",
        "any order of calls",
        _OPENED,
        _OPENED + "        self._flags = protocol.ENABLE\n        self._send(0.1)\n",
    ),
    Mutant(
        "open enables",
        "any order of calls",
        _OPENED,
        _OPENED + "        self._flags = protocol.ENABLE\n        self._send(0.0)\n",
    ),
    Mutant(
        "always enabled",
        "any order of calls",
        "protocol.command(self._sequence, self._flags, speed)",
        "protocol.command(self._sequence, protocol.ENABLE, speed)",
    ),
    Mutant(
        "arm moves",
        "any order of calls",
        "        self._flags = protocol.ENABLE\n        self._send(0.0)\n",
        "        self._flags = protocol.ENABLE\n        self._send(0.3)\n",
    ),
    Mutant("always ready", "ready is true", _READY, "        return True\n"),
    Mutant("ready when ordered", "ready is true", _READY, "        return bool(self._flags)\n"),
    # setpoints
    Mutant("setpoint not clipped", "any order of calls", _CLIPPED, "self._send(speed)"),
    Mutant(
        "clipped on one side", "any order of calls", _CLIPPED, "self._send(min(speed, fastest))"
    ),
    Mutant(
        "clipped to the device",
        "any order of calls",
        _CLIPPED,
        "self._send(min(max(speed, -10), 10))",
    ),
    Mutant(
        "setpoint in mm/s",
        "any order of calls",
        _CLIPPED,
        "self._send(1e-3 * min(max(speed, -fastest), fastest))",
    ),
    Mutant(
        "setpoint inverted",
        "any order of calls",
        _CLIPPED,
        "self._send(-min(max(speed, -fastest), fastest))",
    ),
    Mutant(
        "setpoint positive", "any order of calls", _CLIPPED, "self._send(min(abs(speed), fastest))"
    ),
    Mutant("setpoint ignored", "any order of calls", _CLIPPED, "self._send(0.0)"),
    Mutant(
        "NaN sent", "any order of calls", "        if math.isnan(speed):\n", "        if False:\n"
    ),
    Mutant(
        "NaN stops",
        "any order of calls",
        "        if math.isnan(speed):\n",
        "        if math.isnan(speed):\n            self._send(0.0)\n",
    ),
    # safe
    Mutant("make_safe sends nothing", "any order of calls", _SEND_ZERO, ""),
    Mutant(
        "make_safe leaves it enabled",
        "any order of calls",
        "        self._flags = 0\n        self._enabled = False\n        if",
        "        self._enabled = False\n        if",
    ),
    Mutant(
        "write after make_safe enables",
        "any order of calls",
        _CLIPPED,
        "self._flags = self._flags or int(self._answered is not None)\n        " + _CLIPPED,
    ),
    Mutant("safety not confirmed", "safe while stuck", _CONFIRM, "        if False:\n"),
    Mutant(
        "no answer taken for safe",
        "dead",
        _CONFIRM,
        "        try:\n            self._exchange(SAFE_TRIES)\n        except LinkError:\n"
        "            return\n" + _CONFIRM,
    ),
    Mutant(
        "safety confirmed by an answer",
        "safe while stuck",
        _CONFIRM,
        "        if self._socket is not None and not self._exchange(SAFE_TRIES):\n",
    ),
    Mutant("rescue empty", "any order of calls", _RESCUE, "            pass\n"),
    Mutant(
        "rescue of the old connection",
        "any order of calls",
        _RESCUE,
        "            self.make_safe()\n            self.confirm_safe()\n",
    ),
    Mutant(
        "second close raises",
        "safe and closed before open",
        "        if link is not None:\n            link.close()\n",
        "        link.close()\n",
    ),
    # watchdog
    Mutant(
        "no watchdog declared", "any order of calls", "            watchdog_s=WATCHDOG_S,\n", ""
    ),
    Mutant(
        "watchdog too short",
        "any order of calls",
        "            watchdog_s=WATCHDOG_S,\n",
        "            watchdog_s=0.1 * WATCHDOG_S,\n",
    ),
    Mutant("constant for a proof", "any order of calls", _PROOF, "        tripped_ms = 400\n"),
    Mutant(
        "constant after a wait",
        "watchdog that never acts",
        _PROOF,
        "        time.sleep(2 * WATCHDOG_S)\n        tripped_ms = 400\n",
    ),
    Mutant(
        "proof sends meanwhile",
        "any order of calls",
        "        time.sleep(2 * WATCHDOG_S)\n",
        "        for _ in range(20):\n            self._exchange()\n            time.sleep(0.05)\n",
    ),
    Mutant(
        "proof in ms", "any order of calls", "return tripped_ms * 1e-3", "return float(tripped_ms)"
    ),
    Mutant(
        "thread keeps it alive",
        "any order of calls",
        _OPENED,
        _OPENED + "        self._last = 0.0\n" + _THREAD,
    ),
    Mutant("trip swallowed", "any order of calls", _TRIPPED, "        if False:\n"),
    # rows
    Mutant("damaged frames taken", "garbled", _CRC, '    if head != b"AR":\n', "protocol"),
    Mutant(
        "zero for a damaged frame",
        "garbled",
        _CRC + "        return None\n",
        _CRC + "        return Reply(sequence, 0, 0.0, 0.0, 0)\n",
        "protocol",
    ),
    Mutant(
        "NaN for a damaged frame",
        "garbled",
        _CRC + "        return None\n",
        _CRC + '        return Reply(sequence, 0, float("nan"), float("nan"), 0)\n',
        "protocol",
    ),
    Mutant("same frame again", "frozen", _FRESH, "reply is not None"),
    Mutant(
        "last row again",
        "any order of calls",
        _NO_ROW,
        _NO_ROW.replace("return None", 'return getattr(self, "_row", None)')
        + "        self._row = self.declaration.row.of(position=newest.position,"
        " speed=newest.speed, status=newest.status)\n",
    ),
    Mutant(
        "position in mm",
        "any order of calls",
        "position=newest.position",
        "position=1e3 * newest.position",
    ),
    Mutant(
        "position without sign",
        "any order of calls",
        "position=newest.position",
        "position=abs(newest.position)",
    ),
    Mutant("speed inverted", "any order of calls", "speed=newest.speed", "speed=-newest.speed"),
    Mutant("speed of the setpoint", "any order of calls", "speed=newest.speed", "speed=0.5"),
    Mutant(
        "read waits",
        "bounded",
        "        newest = None\n",
        "        newest = None\n        time.sleep(0.02)\n",
    ),
    Mutant(
        "bare OSError",
        "dead",
        "        except OSError as error:\n            raise self._lost(error) from error\n\n"
        "    def _exchange",
        "        except ValueError as error:\n            raise LinkError(str(error)) from None\n\n"
        "    def _exchange",
    ),
    # opened again, rescued, tripped
    Mutant(
        "rescue tries once",
        "safe while stuck",
        "        finally:\n            self.close()\n",
        "        except LinkError:\n            self.close()\n",
    ),
    Mutant(
        "tripped counts as safe",
        "safe while stuck",
        "        if self._socket is not None and self._exchange(SAFE_TRIES).status"
        " & protocol.ENABLED:\n",
        "        status = self._exchange(SAFE_TRIES).status if self._socket is not None else 0\n"
        "        if status & protocol.ENABLED and not status & protocol.TRIPPED:\n",
    ),
    Mutant(
        "trip at rest is an error",
        "any order of calls",
        "        if self._enabled and newest.status & protocol.TRIPPED:",
        "        if newest.tripped_ms:",
    ),
    Mutant(
        "whole mm/s",
        "any order of calls",
        "self._send(min(max(speed, -fastest), fastest))",
        "self._send(int(1e3 * min(max(speed, -fastest), fastest)) / 1e3)",
    ),
)
