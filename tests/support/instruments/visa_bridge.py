"""A pty with an instrument of pyvisa-sim behind it: a simulator by other authors."""

from __future__ import annotations

import contextlib
import os
import select
import threading
import tty

import pyvisa
from pyvisa.resources import MessageBasedResource

#: How long the bridge waits for an answer of the simulator, in ms: it answers at once, or never.
ANSWER_MS = 50


class Bridge:
    """Hands what comes to a pty to an instrument of pyvisa-sim, and its answers back."""

    def __init__(self, resource: str) -> None:
        self._manager = pyvisa.ResourceManager("@sim")
        opened = self._manager.open_resource(resource, timeout=ANSWER_MS)
        assert isinstance(opened, MessageBasedResource)
        self._instrument = opened
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        self.port = os.ttyname(self._theirs)
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="bridge")
        self._thread.start()

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        self._manager.close()
        os.close(self._ours)
        os.close(self._theirs)

    def _serve(self) -> None:
        received = b""
        while not self._ends.is_set():
            if not select.select([self._ours], [], [], 0.01)[0]:
                continue
            *commands, received = (received + os.read(self._ours, 4096)).split(b"\n")
            for command in commands:
                self._instrument.write_raw(command + b"\n")
                with contextlib.suppress(pyvisa.errors.VisaIOError):  # it has no answer
                    os.write(self._ours, self._instrument.read_raw())
