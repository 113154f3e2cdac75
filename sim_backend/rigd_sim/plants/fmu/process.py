"""Starts the process of an FMU, and asks it within a time limit."""

from __future__ import annotations

import json
import shutil
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

from rigd.model.errors import DeviceError
from rigd_sim.plants.fmu.description import FmuFile
from rigd_sim.plants.fmu.messages import FAILED, LARGEST, REQUEST, STEP, Setup, Wires

#: A value that an FMU takes before it is initialised: its name and the number or text.
Start = tuple[str, float | int | bool | str]
#: Set-up loads Python, libraries and tables: it may take so many deadlines.
SETUP_DEADLINES: Final = 10


class FmuProcess:
    """An FMU, set up with its start values, in a process of its own.

    Args:
        fmu: the file.
        start: values in the FMU's own units.
        step_ns: its communication step.
        deadline_s: the longest time for an answer.
        logging: whether it is asked for all that it can report.

    Raises:
        DeviceError: set-up failed, crashed, or did not return in time; the process has ended. Every
            later request raises the same error again.

    """

    def __init__(
        self,
        fmu: FmuFile,
        start: Sequence[Start],
        *,
        step_ns: int,
        deadline_s: float,
        logging: bool = False,
    ) -> None:
        self._name = fmu.path.name
        self._step_ns = step_ns
        self._deadline_s = deadline_s
        self._failure: DeviceError | None = None
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        folder = tempfile.mkdtemp(prefix="rigd-fmu-")
        self._socket = ours
        #: The folder of the unpacked FMU, which is removed with the process.
        self.folder = Path(folder)
        with theirs:
            self._child = subprocess.Popen(
                [sys.executable, "-m", __package__ + ".worker", str(theirs.fileno()), folder],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,  # a Ctrl-C is for rigd, which ends it in order
            )
        self._close = weakref.finalize(self, _end, self._child, ours, folder)
        setup = Setup(
            path=str(fmu.path),
            sha256=fmu.sha256,
            version=fmu.version,
            folder=folder,
            step_ns=step_ns,
            logging=logging,
            start=[
                (name, fmu.variables[name].kind, fmu.variables[name].reference, value)
                for name, value in start
            ],
        )
        self._ask(json.dumps(asdict(setup)).encode(), "set-up", SETUP_DEADLINES * deadline_s)

    def wire(self, wires: Wires) -> None:
        """Choose what steps set and return.

        Raises:
            DeviceError: see the class.
        """
        self._ask(json.dumps(asdict(wires)).encode(), "the choice of variables", self._deadline_s)

    def take(self, first: int, count: int, inputs: Sequence[float]) -> list[float]:
        """Take ``count`` steps from number ``first`` on with ``inputs`` held; return the outputs.

        Raises:
            DeviceError: see the class.
        """
        what = f"the step at {first * self._step_ns * 1e-9:.9g} s"
        request = REQUEST.pack(STEP, first, count) + struct.pack(f"<{len(inputs)}d", *inputs)
        answer = self._ask(request, what, max(1, count) * self._deadline_s)
        return [value for (value,) in struct.iter_unpack("<d", answer)]

    def fail(self, reason: str) -> DeviceError:
        """End the process, and return the error that every later request raises."""
        self._failure = DeviceError(f"{self._name}: {reason}")
        self.close()
        return self._failure

    def close(self) -> None:
        """End the process; a second call does nothing."""
        self._close()

    def _ask(self, request: bytes, what: str, limit_s: float) -> bytes:
        if self._failure is not None:
            raise self._failure
        if not self._close.alive:
            raise DeviceError(f"{self._name}: its process was ended")
        try:
            self._socket.settimeout(limit_s)
            self._socket.send(request)
            answer = self._socket.recv(LARGEST)
        except TimeoutError:
            raise self.fail(f"{what} did not return within {limit_s:g} s") from None
        except OSError:
            answer = b""
        if not answer:
            raise self.fail(f"{what} crashed: its process {self._ending()}")
        if answer[:1] == FAILED:
            raise self.fail(answer[1:].decode("utf-8", errors="replace"))
        return answer[1:]

    def _ending(self) -> str:
        try:
            code = self._child.wait(1.0)
        except subprocess.TimeoutExpired:
            return "closed its connection"
        if code >= 0:
            return f"ended with code {code}"
        try:
            return f"was ended by {signal.Signals(-code).name}"
        except ValueError:
            return f"was ended by signal {-code}"


def _end(child: subprocess.Popen[bytes], connection: socket.socket, folder: str) -> None:
    child.kill()
    connection.close()
    child.wait()
    if Path(folder).exists():
        shutil.rmtree(folder, ignore_errors=True)
