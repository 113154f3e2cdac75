"""Starts, supervises and ends the helper process of a block device."""

from __future__ import annotations

import pickle
import select
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from rigd.config.rig import DeviceConfig
from rigd.engine.child import Child, module
from rigd.engine.clock import monotonic_ns
from rigd.engine.slow.block_job import GRACE_S, MAX_PACKET, BlockJob, Failed, Opened
from rigd.engine.slow.table import LatestTable
from rigd.model.channels import Stream
from rigd.model.errors import DeviceError, LinkError, ProtocolError, RigdError

#: Opening may take so long: a device server is reached, a card set up.
OPEN_S: Final = 30.0
#: A helper without a sign of life for so long hangs in its library.
SILENCE_S: Final = 2.0
#: The helper is not judged by its silence where the daemon itself was away for so long.
AWAY_S: Final = 0.5
#: A process whose end of the link is closed is gone within this; the daemon must not wait longer.
_REAP_S: Final = 0.1


class BlockHelper:
    """Runs one block device in a process of its own.

    Args:
        device: the device.
        ring: path of the ring of its stream, made already; None where it is not recorded.
        table: path of the table of latest values, made already.
        table_streams: the streams that the table has slots for.
        start_ns: Unix time of the run's beginning.
        origin_ns: monotonic time of the same moment.
        log: file that takes what the process prints.
        lock_fd: the rig's lock, which the process holds as long as it lives; -1 where there is
            none.
        silence_s: after how long a silent process counts as hung.
        every: every so many rows one is recorded.
        windowed: whether the table says when rows are recorded; else they are always.
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
    ) -> None:
        self.name = device.name
        self.identity = ""  #: what the device said it is, once started
        self.rate_hz = 0.0  #: rows per second, once started
        self.unfit: tuple[str, ...] = ()  #: what keeps the device from being armed
        streams = tuple(table_streams)
        self._job = BlockJob(device, ring, every, table, streams, start_ns, origin_ns, windowed)
        self._slot = LatestTable.attach(table, streams).slot(device.name)
        self._log = log
        self._lock_fd = lock_fd
        self._silence_ns = round(silence_s * 1e9)
        self._child: Child | None = None
        self._link: socket.socket | None = None
        self._fault: str | None = None
        self._beat_ns = 0  # the sign of life last seen,
        self._heard_ns = 0  # and when it was
        self._looked_ns = 0

    @property
    def pid(self) -> int:
        """Process id of the helper; 0 before it was started."""
        return 0 if self._child is None else self._child.pid

    def start(self, timeout_s: float = OPEN_S) -> None:
        """Start the process and wait until the device is open; rows follow at once.

        Raises:
            LinkError: the device cannot be reached, or is not open in time.
            ProtocolError: it is not the one that the rig file names.
            DeviceError: it reports a fault, or its driver fails.
        """
        self._link, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            fd = theirs.fileno()
            command = module("rigd.engine.slow.block_process", str(fd))
            self._child = Child(command, log=self._log, fds=(fd, self._lock_fd))
        self._link.send(pickle.dumps(self._job))
        try:
            self._wait_until_open(timeout_s)
        except BaseException:
            self.stop()
            raise
        self._heard_ns = self._looked_ns = monotonic_ns()

    def _wait_until_open(self, timeout_s: float) -> None:
        if not self._has_message(timeout_s):
            raise LinkError(f"{self.name} was not open within {timeout_s:g} s")
        match self._receive():
            case Opened(identity, rate_hz, unfit):
                self.identity, self.rate_hz, self.unfit = identity, rate_hz, unfit
            case Failed() as failed:
                raise self._error(failed)
            case _:
                raise DeviceError(self._death())

    def poll(self) -> str | None:
        """Return why the run must end, or None; once there is a reason, it stays."""
        if self._fault is None and self._link is not None:
            self._fault = self._look()
        return self._fault

    def _look(self) -> str | None:
        if self._has_message(0.0):
            message = self._receive()
            return self._error(message).told if isinstance(message, Failed) else self._death()
        now, beat_ns = monotonic_ns(), self._slot.beat_ns
        if beat_ns != self._beat_ns or now - self._looked_ns > AWAY_S * 1e9:
            self._beat_ns, self._heard_ns = beat_ns, now
        self._looked_ns = now
        silent_ns = now - self._heard_ns
        if silent_ns > self._silence_ns:
            return (
                f"{self.name}: its process {self.pid} gave no sign of life for "
                f"{silent_ns / 1e9:.1f} s: its library hangs, or it was stopped"
            )
        return None

    def stop(self) -> None:
        """End the process, by force where it hangs; stopping twice is silent."""
        if self._link is None or self._child is None:
            return
        self._link.close()
        self._link = None
        if not self._child.wait(GRACE_S + 1.0):
            self._child.fence(None)

    def _has_message(self, timeout_s: float) -> bool:
        return bool(select.select([self._opened_link()], [], [], timeout_s)[0])

    def _receive(self) -> object:
        """Return the next message; None where the process has closed its end."""
        try:
            packet = self._opened_link().recv(MAX_PACKET)
        except ConnectionResetError:  # it died without reading its job
            packet = b""
        return pickle.loads(packet) if packet else None

    def _opened_link(self) -> socket.socket:
        if self._link is None:
            raise RuntimeError(f"the helper of {self.name} is not started")
        return self._link

    def _error(self, failed: Failed) -> RigdError:
        """Return what the helper failed with, with the device's name in front."""
        kinds: dict[str, type[RigdError]] = {
            item.__name__: item for item in (LinkError, ProtocolError, DeviceError)
        }
        kind = kinds.get(failed.kind, DeviceError)
        return kind(f"{self.name}: {failed.message}", hint=failed.hint)

    def _death(self) -> str:
        if self._child is None:
            raise RuntimeError(f"the helper of {self.name} is not started")
        self._child.wait(_REAP_S)
        how = self._child.ended or "it has closed its connection"
        words = self._child.last_words()
        return f"{self.name}: its process ended by itself ({how})" + (f": {words}" if words else "")
