"""Runs one instrument of PyMeasure in a process of its own, in which its library may wait.

``python -m rigd_drivers.instruments.pymeasure_bridge.helper FD`` reads a job and then requests from
a socket, a line of JSON each, and answers each in order. Once the other end is closed, also because
its process was killed, it makes the instrument safe if that has been acted on since it was safe,
closes it, and ends.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import queue
import signal
import socket
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any, Final

from rigd_drivers.instruments.pymeasure_bridge import attributes

#: How long an answer that did not come in time is waited for, in s, before it counts as lost.
LATE_S: Final = 0.3
#: The process ends so long after the other end is closed, in s, also if its library hangs.
GRACE_S: Final = 5.0
#: An attribute that is written, or a method that is called: then the value is None.
Step = tuple[str, Any]


class _Log(logging.Handler):
    """Collects errors that PyMeasure logs: of the queue of an instrument it raises none."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.errors: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the message."""
        self.errors.append(record.getMessage())


class Session:
    """An instrument, and what the daemon asks of it."""

    def __init__(self, job: dict[str, Any]) -> None:
        self._job = job
        self._instrument: Any = None
        self._acted: bool = job["acted"]  # since it was safe, also by a process before this one
        self._log = _Log()
        logging.getLogger().addHandler(self._log)

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        """Return the answer to ``request``: its value, or the kind and text of its error."""
        import pyvisa

        try:
            value = self._do(request)
        except pyvisa.errors.VisaIOError as error:
            if error.error_code != pyvisa.constants.StatusCode.error_timeout:
                return {"kind": "lost", "text": str(error)}
            self._settle()
            return {"kind": "silent", "text": "it does not answer in time"}
        except (OSError, EOFError, pyvisa.errors.InvalidSession) as error:
            return {"kind": "lost", "text": _text(error)}
        except attributes.Unusable as error:
            return {"kind": "refused", "text": str(error)}
        except Exception as error:  # noqa: BLE001 - boundary: told to the daemon
            return {"kind": "refused", "text": _text(error)}
        return {"value": value}

    def end(self) -> None:
        """Make it safe, over a new connection if need be, and close it."""
        with contextlib.suppress(Exception):
            if self._acted:
                answer = self.answer({"do": "safe"})
                if "kind" in answer and "value" in self.answer({"do": "open"}):
                    self.answer({"do": "safe"})
        self._close()

    def _do(self, request: dict[str, Any]) -> Any:
        match request["do"]:
            case "open":
                self._open()
            case "start":
                self._acted = True
                self._steps(self._job["start"])
            case "safe":
                self._make_safe()
                self._acted = False
            case "steps":
                self._acted = True
                self._steps(request["steps"])
            case "read":
                return attributes.read(self._instrument, request["path"])
            case "call":
                return attributes.call(self._instrument, request["path"])
        return None

    def _open(self) -> None:
        self._close()
        job = self._job
        library = {"visa_library": job["visa_library"]} if job["visa_library"] else {}
        kind = attributes.find_class(job["instrument"])
        self._instrument = kind(job["address"], **library, **job["connection"])
        connection: Any = getattr(self._instrument.adapter, "connection", None)
        if connection is not None and not hasattr(connection, "write"):
            raise attributes.Unusable(f"{job['address']} is no VISA resource that takes commands")
        if connection is not None and hasattr(connection, "timeout"):
            connection.timeout = job["timeout_ms"]

    def _steps(self, steps: Sequence[Step]) -> None:
        self._log.errors.clear()
        for path, value in steps:
            if value is None:
                attributes.call(self._instrument, path)
            else:
                attributes.write(self._instrument, path, value)
        if self._log.errors:
            raise attributes.Unusable("; ".join(self._log.errors))

    def _make_safe(self) -> None:
        """Try each step of `safe`, also behind one that fails; then raise the first error."""
        import pyvisa

        first: Exception | None = None
        for step in self._job["safe"]:
            try:
                self._steps([step])
            except (OSError, EOFError, pyvisa.errors.InvalidSession):
                raise  # without a connection no later step can be done
            except Exception as error:  # noqa: BLE001 - raised below
                first = first or error
        if first is not None:
            raise first

    def _settle(self) -> None:
        """Throw away an answer that comes late, else it would be taken for the next one."""
        time.sleep(LATE_S)
        with contextlib.suppress(Exception):
            self._instrument.adapter.flush_read_buffer()

    def _close(self) -> None:
        instrument, self._instrument = self._instrument, None
        if instrument is not None:
            with contextlib.suppress(Exception):  # the adapter may have been pulled out
                instrument.adapter.close()


def serve(link: socket.socket) -> None:
    """Answer the requests that come over ``link`` until it is closed."""
    lines = link.makefile("rb")
    session = Session(json.loads(lines.readline()))
    requests: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def listen() -> None:
        line = b" "
        while line:
            try:
                line = lines.readline()
            except OSError:
                line = b""
            requests.put(line)
        time.sleep(GRACE_S)
        os._exit(1)  # its library hangs

    threading.Thread(target=listen, name="listen", daemon=True).start()
    while line := requests.get():
        request = json.loads(line)
        answer = {"id": request["id"], **session.answer(request)}
        with contextlib.suppress(OSError):  # nobody reads it any more
            link.sendall(json.dumps(answer).encode() + b"\n")
    session.end()


def _text(error: Exception) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):  # it ends with the daemon
        signal.signal(number, signal.SIG_IGN)
    with contextlib.suppress(OSError):  # a rescue starts it from the cycle, which has priority
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    with socket.socket(fileno=int(sys.argv[1])) as own_end:
        serve(own_end)
