"""Runs one block device (its library returns blocks of rows) in a helper process.

The device's library may block in this process. :class:`~rigd.engine.slow.block_helper.BlockHelper`
starts ``python -m rigd.engine.slow.block_process FD`` with one end of a socket. The helper process
ends when the other end of the socket is closed: on purpose by the daemon, or because the daemon
died.
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
from typing import Final

from rigd.engine.clock import monotonic_ns
from rigd.engine.cycle.block_rows import BlockRecorder, BlockRows
from rigd.engine.shared.rowring import RowRing
from rigd.engine.slow.block_job import GRACE_S, MAX_PACKET, BlockJob, Failed, Opened
from rigd.engine.slow.table import LatestTable
from rigd.engine.system.realtime import HELPER_PRIORITY, RealTime
from rigd.model.errors import DeviceError, RigdError
from rigd.sdk import Block, BlockDriver

#: Interval of signs of life while there are no rows.
BEAT_S: Final = 0.1


class Publisher:
    """Records the blocks of one device, and writes the newest row into the table for the cycle."""

    def __init__(self, job: BlockJob, driver: BlockDriver) -> None:
        stream = job.device.stream
        table = LatestTable.attach(job.table, job.table_streams)
        self._driver = driver
        self._slot = table.slot(stream.name)
        self._rows = BlockRows(stream, job.start_ns - job.origin_ns)
        self._recorder: BlockRecorder | None = None
        if job.ring is not None:
            windows = table.windows(stream.name) if job.windowed else None
            self._recorder = BlockRecorder(RowRing.attach(job.ring, stream), job.every, windows)

    def beat(self) -> None:
        """Give a sign of life, and record rows about which the cycle has decided meanwhile."""
        self._slot.beat(monotonic_ns())
        if self._recorder is not None:
            self._recorder.settle()

    def publish(self, block: Block) -> None:
        """Record the rows of ``block`` and show the newest row to the cycle.

        Raises:
            DeviceError: the block violates the interface of drivers.
        """
        rows = self._rows.make(block)
        if not len(rows):
            return
        if self._recorder is not None:
            self._recorder.take(rows)
        self._slot.write(int(block.times_ns[-1]), self._driver.newest_row(block))

    def finish(self) -> None:
        """Record the rows that still wait for a decision."""
        if self._recorder is not None:
            self._recorder.finish()


def serve(link: socket.socket) -> int:
    """Run the device of the job that arrives over ``link`` until its end; return an exit code."""
    job: BlockJob = pickle.loads(link.recv(MAX_PACKET))
    stop = threading.Event()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    RealTime().schedule(HELPER_PRIORITY)  # before any thread starts, so that threads inherit it
    threading.Thread(target=_watch, args=(link, stop), name="watch", daemon=True).start()
    failed: Failed | None = None
    try:
        _run(job, link, stop)
    except Exception as error:  # noqa: BLE001 - boundary: told to the daemon, which ends the run
        failed = _failed(error)
    if failed is not None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # no reader is left
            link.send(pickle.dumps(failed))
    return 0 if failed is None else 1


def _run(job: BlockJob, link: socket.socket, stop: threading.Event) -> None:
    device = job.device
    driver = device.driver_class(device.config, None)
    if not isinstance(driver, BlockDriver):
        raise TypeError(f"{device.driver} is not a block driver")
    publisher = Publisher(job, driver)
    try:
        driver.open()
        opened = Opened(driver.identity, driver.rate_hz, tuple(driver.preflight()))
        driver.start()
        publisher.beat()  # from here on its silence is judged; a slow start is none
        link.send(pickle.dumps(opened))
        try:
            while not stop.is_set():
                publisher.beat()
                block = driver.read_block(BEAT_S)
                if block is not None:
                    publisher.publish(block)
        finally:
            publisher.finish()
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
    traceback.print_exception(error)  # the daemon keeps this output
    return Failed(DeviceError.__name__, f"its driver fails: {type(error).__name__}: {error}", None)


def _watch(link: socket.socket, stop: threading.Event) -> None:
    """Wait for the end of the link; then give the device a while to close."""
    with contextlib.suppress(ConnectionResetError):  # the daemon ended with unread messages
        while link.recv(1):
            pass
    stop.set()
    threading.Event().wait(GRACE_S)
    os._exit(1)  # the library still blocks


if __name__ == "__main__":
    with socket.socket(fileno=int(sys.argv[1])) as own_end:
        code = serve(own_end)
    sys.exit(code)
