"""Starts, supervises and ends the helper process that runs one block device.

A block device is a device whose library returns blocks of rows. A call of the library may block, so
each such device has a process of its own.
"""

from __future__ import annotations

import pickle
import socket
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from rigd.config.rig import DeviceConfig
from rigd.engine.clock import monotonic_ns
from rigd.engine.slow.block_job import GRACE_S, MAX_PACKET, BlockJob, Failed, Opened
from rigd.engine.slow.table import LatestTable
from rigd.engine.system.child import Child, module
from rigd.model.channels import Stream
from rigd.model.errors import DeviceError, LinkError, ProtocolError, RigdError
from rigd.model.machine.system import readable

#: Longest time for opening: connect to a device server, set up a card and start it.
OPEN_S: Final = 30.0
#: A helper without a sign of life for this time hangs in its library.
SILENCE_S: Final = 2.0
#: The helper is not judged if the daemon itself was delayed for this time.
AWAY_S: Final = 0.5
#: A process ends within this time after its link is closed; the daemon must not wait longer.
_REAP_S: Final = 0.1
#: How often a helper that opens its device looks whether a stop is requested.
_LOOK_S: Final = 0.05


class BlockHelper:
    """Runs one block device in a process of its own.

    Args:
        device: the device.
        ring: path of the existing ring of its stream; None if it is not recorded.
        table: path of the existing table of latest values.
        table_streams: the streams that have a slot in the table.
        start_ns: Unix time of the start of the run.
        origin_ns: monotonic time of the same moment.
        log: file for the output of the process.
        lock_fd: the rig's lock, which the process holds while it runs; -1 if there is none.
        silence_s: silence after which the process counts as hung.
        every: every ``every``-th row is recorded.
        windowed: whether the table has recording windows; else rows are always recorded.
        stopped: whether a stop is requested, which ends the opening.
    """

    def __init__(
        self,
        device: DeviceConfig,
        *,
        ring: Path | None,
        table: Path,
        table_streams: Sequence[Stream],
        start_ns: int,
        origin_ns: int,
        log: Path,
        lock_fd: int = -1,
        silence_s: float = SILENCE_S,
        every: int = 1,
        windowed: bool = False,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self.name = device.name
        self.identity = ""  #: the identity of the device, after the start
        self.rate_hz = 0.0  #: rows per second, after the start
        self.arming_blockers: tuple[str, ...] = ()  #: reasons why the device cannot be armed
        streams = tuple(table_streams)
        self._job = BlockJob(device, ring, every, table, streams, start_ns, origin_ns, windowed)
        self._slot = LatestTable.attach(table, streams).slot(device.name)
        self._log = log
        self._lock_fd = lock_fd
        self._silence_ns = round(silence_s * 1e9)
        self._stopped = stopped
        self._child: Child | None = None
        self._link: socket.socket | None = None
        self._fault: str | None = None
        self._beat_ns = 0  # the last sign of life,
        self._checked_ns = 0  # and its time of arrival
        self._looked_ns = 0

    @property
    def pid(self) -> int:
        """Process id of the helper; 0 before the start."""
        return 0 if self._child is None else self._child.pid

    def start(self, timeout_s: float = OPEN_S) -> None:
        """Start the process and wait until the device is open and samples.

        Raises:
            LinkError: the device cannot be reached, or is not open in time.
            ProtocolError: it is not the device that the rig file names.
            DeviceError: it reports a fault, or its driver fails.
        """
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            fd = theirs.fileno()
            command = module("rigd.engine.slow.block_process", str(fd))
            self._child = Child(command, log=self._log, fds=(fd, self._lock_fd), preferred=True)
        self._link.send(pickle.dumps(self._job))
        try:
            self._wait_until_open(timeout_s)
        except BaseException:
            self.stop()
            raise
        self._checked_ns = self._looked_ns = monotonic_ns()

    def _wait_until_open(self, timeout_s: float) -> None:
        until_ns = monotonic_ns() + round(timeout_s * 1e9)
        while not self._has_message(min(_LOOK_S, timeout_s)):
            if self._stopped():
                raise DeviceError(f"{self.name} was not opened: a stop was requested")
            if monotonic_ns() > until_ns:
                raise LinkError(f"{self.name} was not open within {timeout_s:g} s")
        match self._receive():
            case Opened(identity, rate_hz, arming_blockers):
                self.identity, self.rate_hz, self.arming_blockers = (
                    identity,
                    rate_hz,
                    arming_blockers,
                )
            case Failed() as failed:
                raise self._error(failed)
            case _:
                raise DeviceError(self._death())

    def poll(self) -> str | None:
        """Return why the run must end, or None; a reason stays."""
        if self._fault is None and self._link is not None:
            self._fault = self._look()
        return self._fault

    def _look(self) -> str | None:
        if self._has_message(0.0):
            message = self._receive()
            return self._error(message).one_line if isinstance(message, Failed) else self._death()
        now, beat_ns = monotonic_ns(), self._slot.beat_ns
        if beat_ns != self._beat_ns or now - self._looked_ns > AWAY_S * 1e9:
            self._beat_ns, self._checked_ns = beat_ns, now
        self._looked_ns = now
        silent_ns = now - self._checked_ns
        if silent_ns > self._silence_ns:
            if self._child is not None and self._child.fate(0.0):
                return self._death()
            return (
                f"{self.name}: its process {self.pid} gave no sign of life for "
                f"{silent_ns / 1e9:.1f} s: its library hangs, the process was "
                "stopped, or other programs leave it no time"
            )
        return None

    def stop(self) -> None:
        """End the process, by force if it hangs; stopping twice is silent."""
        if self._link is None or self._child is None:
            return
        self._link.close()
        self._link = None
        if not self._child.wait(GRACE_S + 1.0):
            self._child.fence(None)

    def _has_message(self, timeout_s: float) -> bool:
        return readable(self._opened_link(), timeout_s)

    def _receive(self) -> object:
        """Return the next message; None if the process has closed its end."""
        try:
            packet = self._opened_link().recv(MAX_PACKET)
        except ConnectionResetError:  # it ended without reading its job
            packet = b""
        return pickle.loads(packet) if packet else None

    def _opened_link(self) -> socket.socket:
        if self._link is None:
            raise RuntimeError(f"the helper of {self.name} is not started")
        return self._link

    def _error(self, failed: Failed) -> RigdError:
        """Return the error of the helper, with the device's name in front."""
        kinds: dict[str, type[RigdError]] = {
            item.__name__: item for item in (LinkError, ProtocolError, DeviceError)
        }
        kind = kinds.get(failed.kind, DeviceError)
        return kind(f"{self.name}: {failed.message}", hint=failed.hint)

    def _death(self) -> str:
        if self._child is None:
            raise RuntimeError(f"the helper of {self.name} is not started")
        self._child.wait(_REAP_S)
        how = self._child.fate(0.0) or "has closed its connection"
        words = self._child.last_words()
        return f"{self.name}: its process {how}" + (f": {words}" if words else "")
