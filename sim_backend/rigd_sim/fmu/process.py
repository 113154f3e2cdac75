"""Starts the process of an FMU, and asks it within a time limit."""

from __future__ import annotations

import json
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path

from rigd.model.errors import DeviceError
from rigd.model.machine.other_process import child_ending, how_ended
from rigd.model.machine.system import require_linux
from rigd_sim.fmu.description import FmuFile
from rigd_sim.fmu.messages import FAILED, LARGEST, REQUEST, STEP, Setup, Wires

#: A value that an FMU takes before it is initialised: its name and the number or text.
Start = tuple[str, float | int | bool | str]


class FmuProcess:
    """An FMU, set up with its start values, in a process of its own.

    Args:
        fmu: the file.
        start: values in the FMU's own units.
        step_ns: its communication step.
        setup_s: the longest time for loading and initialising it.
        deadline_s: the longest time for every other answer.
        logging: whether it is asked for all that it can report.
        priority: of SCHED_FIFO at which it takes its steps, 0 for an ordinary program.

    Raises:
        DeviceError: set-up failed, crashed, or did not return in time; the process has ended. Every
            later request raises the same error again.
        NeedsLinux: this is another system.

    """

    def __init__(
        self,
        fmu: FmuFile,
        start: Sequence[Start],
        *,
        step_ns: int,
        setup_s: float,
        deadline_s: float,
        logging: bool = False,
        priority: int = 0,
    ) -> None:
        require_linux("an FMU in a process of its own")
        self._name = fmu.path.name
        self._step_ns = step_ns
        self._deadline_s = deadline_s
        self._failure: DeviceError | None = None
        self._what = ""  #: what was begun last, for an error
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
            priority=priority,
            start=[
                (name, fmu.variables[name].kind, fmu.variables[name].reference, value)
                for name, value in start
            ],
        )
        self._ask(json.dumps(asdict(setup)).encode(), "set-up", setup_s)

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
        self.begin(first, count, inputs)
        return self.wait(count)[1]

    def begin(self, first: int, count: int, inputs: Sequence[float]) -> None:
        """Begin steps as :meth:`take` does, whose answer :meth:`wait` or :meth:`poll` returns.

        Raises:
            DeviceError: an earlier request has failed.
        """
        self._what = f"the step at {first * self._step_ns * 1e-9:.9g} s"
        self._send(REQUEST.pack(STEP, first, count) + struct.pack(f"<{len(inputs)}d", *inputs))

    def wait(self, count: int) -> tuple[float, list[float]]:
        """Wait for ``count`` steps that were begun; return as :meth:`poll` does.

        Raises:
            DeviceError: see the class.
        """
        answer = self._answer(self._what, max(1, count) * self._deadline_s)
        took_s, *outputs = struct.unpack(f"<{len(answer) // 8}d", answer)
        return took_s, outputs

    def poll(self) -> tuple[float, list[float]] | None:
        """Return how long the steps took, in s, and the outputs; None if they are not there yet.

        Never waits, not for the process to end either: a process that has just crashed may give
        None until the kernel states how.

        Raises:
            DeviceError: see the class. The process is only killed: :meth:`close` cleans up.
        """
        if self._failure is not None:
            raise self._failure
        # Python waits for a socket that has a timeout, MSG_DONTWAIT or not.
        self._socket.settimeout(0.0)
        try:
            answer = self._socket.recv(LARGEST)
        except BlockingIOError:
            return None
        except OSError:
            answer = b""
        if not answer:
            code = self._child.poll()
            if code is None:
                return None
            raise self.refuse(f"{self._what} crashed: its process {how_ended(code)}")
        if answer[:1] == FAILED:
            raise self.refuse(answer[1:].decode("utf-8", errors="replace"))
        took_s, *outputs = struct.unpack(f"<{len(answer) // 8}d", memoryview(answer)[1:])
        return took_s, outputs

    def refuse(self, reason: str) -> DeviceError:
        """Kill the process without waiting for it; return the error as :meth:`fail` does."""
        self._failure = DeviceError(f"{self._name}: {reason}")
        self._child.kill()
        return self._failure

    def fail(self, reason: str) -> DeviceError:
        """End the process, and return the error that every later request raises."""
        error = self.refuse(reason)
        self.close()
        return error

    def close(self) -> None:
        """End the process; a second call does nothing."""
        self._close()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._child.pid

    def _ask(self, request: bytes, what: str, limit_s: float) -> bytes:
        self._send(request)
        return self._answer(what, limit_s)

    def _send(self, request: bytes) -> None:
        if self._failure is not None:
            raise self._failure
        if not self._close.alive:
            raise DeviceError(f"{self._name}: its process was ended")
        # One request at a time: the socket has room for it. If the process has ended, the answer
        # shows it.
        with suppress(OSError):
            self._socket.send(request)

    def _answer(self, what: str, limit_s: float) -> bytes:
        try:
            self._socket.settimeout(limit_s)
            answer = self._socket.recv(LARGEST)
        except TimeoutError:
            if child_ending(self.pid):
                raise self.fail(f"{what} crashed: its process {self._ending()}") from None
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
        return how_ended(code)


def _end(child: subprocess.Popen[bytes], connection: socket.socket, folder: str) -> None:
    child.kill()
    connection.close()
    child.wait()
    if Path(folder).exists():
        shutil.rmtree(folder, ignore_errors=True)
