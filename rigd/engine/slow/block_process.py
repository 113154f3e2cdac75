"""The helper process of one block device: its library may block here as long as it likes.

Started by :class:`~rigd.engine.slow.BlockHelper` as ``python -m rigd.engine.slow.block_process FD``
with one end of a socket. It ends when told (the other end is closed), which is also what the
daemon's death looks like.
"""

from __future__ import annotations

import contextlib
import os
import pickle
import signal
import socket
import sys
import threading
import traceback
from typing import Any, Final

import numpy as np

from rigd.engine.clock import monotonic_ns
from rigd.engine.realtime import HELPER_PRIORITY, RealTime
from rigd.engine.shared.rowring import RowRing
from rigd.engine.slow.block_job import GRACE_S, MAX_PACKET, BlockJob, Failed, Opened
from rigd.engine.slow.table import LatestTable
from rigd.model.channels import STATUS_FIELD, Stream
from rigd.model.errors import DeviceError, RigdError
from rigd.model.rows import TIME_FIELD, row_dtype
from rigd.sdk import Block, BlockDriver

#: A sign of life is given this often while there are no rows.
BEAT_S: Final = 0.1
_VALUES: Final = "values"


class Publisher:
    """Puts blocks of one device into its ring, and the newest row into the table."""

    def __init__(self, job: BlockJob) -> None:
        self._stream = job.device.stream
        self._offset_ns = job.start_ns - job.origin_ns
        self._ring = None if job.ring is None else RowRing.attach(job.ring, self._stream)
        self._every = job.every
        self._skip = 0  # rows until the next one that is recorded
        self._slot = LatestTable.attach(job.table, job.table_streams).slot(self._stream.name)
        self._width = len(self._stream.channels) + self._stream.has_status
        self._layout = _layout(self._stream)
        self._last_ns = 0

    def beat(self) -> None:
        """Give a sign of life."""
        self._slot.beat(monotonic_ns())

    def publish(self, block: Block) -> None:
        """Push the rows of ``block``.

        Raises:
            DeviceError: they are not as the driver has to give them.
        """
        times_ns, values = block.times_ns, block.values
        if values.shape != (len(times_ns), self._width):
            raise DeviceError(
                f"the driver gave values of shape {values.shape} for {len(times_ns)} times, "
                f"expected ({len(times_ns)}, {self._width})",
                hint="correct its read_block()",
            )
        if not len(times_ns):
            return
        if times_ns[0] <= self._last_ns or np.any(np.diff(times_ns) <= 0):
            raise DeviceError(
                "the driver gave times that do not increase", hint="correct its read_block()"
            )
        self._last_ns = int(times_ns[-1])
        rows = np.empty(len(times_ns), self._layout)
        rows[TIME_FIELD] = times_ns + self._offset_ns
        rows[_VALUES] = values[:, : len(self._stream.channels)]
        if self._stream.has_status:
            rows[STATUS_FIELD] = values[:, -1].astype(np.uint32)
        if self._ring is not None:
            recorded = rows.view(row_dtype(self._stream))[self._skip :: self._every]
            self._ring.push_block(recorded)
            self._skip = (self._skip - len(rows)) % self._every
        self._slot.write(self._last_ns, values[-1].tolist())


def _layout(stream: Stream) -> np.dtype[np.void]:
    """Return the bytes of :func:`~rigd.model.rows.row_dtype` with all channels as one field."""
    fields: list[Any] = [(TIME_FIELD, "<i8"), (_VALUES, "<f8", (len(stream.channels),))]
    if stream.has_status:
        fields.append((STATUS_FIELD, "<u4"))
    return np.dtype(fields)


def serve(link: socket.socket) -> int:
    """Run the device of the job that comes over ``link`` until told to end; return an exit code."""
    job: BlockJob = pickle.loads(link.recv(MAX_PACKET))
    stop = threading.Event()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    RealTime().schedule(HELPER_PRIORITY)  # before there are threads, so that they inherit it
    threading.Thread(target=_watch, args=(link, stop), name="watch", daemon=True).start()
    failed: Failed | None = None
    try:
        _run(job, link, stop)
    except Exception as error:  # noqa: BLE001 - boundary: told to the daemon, which ends the run
        failed = _failed(error)
    if failed is not None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # nobody there to be told
            link.send(pickle.dumps(failed))
    return 0 if failed is None else 1


def _run(job: BlockJob, link: socket.socket, stop: threading.Event) -> None:
    device = job.device
    driver = device.driver_class(device.config, None)
    if not isinstance(driver, BlockDriver):
        raise TypeError(f"{device.driver} is no block driver")
    publisher = Publisher(job)
    try:
        driver.open()
        told = Opened(driver.identity, driver.rate_hz, tuple(driver.preflight()))
        link.send(pickle.dumps(told))
        driver.start()
        while not stop.is_set():
            publisher.beat()
            block = driver.read_block(BEAT_S)
            if block is not None:
                publisher.publish(block)
    except BaseException:
        try:
            driver.close()
        except Exception as error:  # noqa: BLE001 - what failed first is what is told
            traceback.print_exception(error)
        raise
    driver.close()


def _failed(error: Exception) -> Failed:
    if isinstance(error, RigdError):
        return Failed(type(error).__name__, error.message, error.hint)
    traceback.print_exception(error)  # where the daemon keeps what this process prints
    return Failed(DeviceError.__name__, f"its driver fails: {type(error).__name__}: {error}", None)


def _watch(link: socket.socket, stop: threading.Event) -> None:
    """Wait for the end of the link; then give the device a while to be closed."""
    with contextlib.suppress(ConnectionResetError):  # the daemon died with words of ours unread
        while link.recv(1):
            pass
    stop.set()
    threading.Event().wait(GRACE_S)
    os._exit(1)  # the library still blocks


if __name__ == "__main__":
    with socket.socket(fileno=int(sys.argv[1])) as own_end:
        code = serve(own_end)
    sys.exit(code)
