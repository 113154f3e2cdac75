"""Runs the drivers of slow devices as coroutines on one event loop, in a thread of the daemon.

A slow device needs longer than a cycle to respond.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine, Mapping, Sequence
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any, Final, Protocol, TypeVar

from rigd.engine.clock import monotonic_ns
from rigd.engine.cycle import DEVICE_ERRORS
from rigd.engine.slow.table import Slot
from rigd.model.errors import DeviceError, LinkError, RigdError
from rigd.sdk import EmitRow, SlowDriver

#: Longest time for opening: a scale that was off warms up.
OPEN_S: Final = 20.0
#: Longest time for an action: a scale waits until it is at rest.
ACT_S: Final = 15.0
#: Longest time for a device to stop and close.
CLOSE_S: Final = 3.0
#: A loop that is blocked for this time is blocked by a driver.
BLOCKED_S: Final = 2.0
#: The loop is not judged if the daemon itself was delayed for this time.
AWAY_S: Final = 0.5
_TURN_S: Final = 0.1

T = TypeVar("T")


class SlowRowSink(Protocol):
    """Receives rows of one stream; a ring is such a sink."""

    def push(self, t_ns: int, row: Sequence[float]) -> None:
        """Append a row, taken at ``t_ns`` (Unix)."""
        ...


class SlowDevices:
    """Runs slow drivers concurrently; a failure of a driver does not stop the others.

    Args:
        drivers: the drivers by the names of their devices, not opened yet.
        rings: sinks for the rows of recorded devices.
        slots: their places in the table of latest values.
        start_ns: Unix time of the start of the run.
        origin_ns: monotonic time of the same moment.
    """

    def __init__(
        self,
        drivers: Mapping[str, SlowDriver],
        *,
        rings: Mapping[str, SlowRowSink],
        slots: Mapping[str, Slot],
        start_ns: int,
        origin_ns: int,
    ) -> None:
        self._drivers = dict(drivers)
        self._rings = rings
        self._slots = slots
        self._offset_ns = start_ns - origin_ns
        self._faults: dict[str, str] = {}  # by device, in order of occurrence
        self._loop: asyncio.AbstractEventLoop | None = None  # while it runs
        self._thread: threading.Thread | None = None
        self._running: dict[str, asyncio.Task[None]] = {}
        self._turned_ns = self._looked_ns = 0

    @property
    def identities(self) -> dict[str, str]:
        """The identity that each device reported, after the start."""
        return {name: driver.identity for name, driver in self._drivers.items()}

    @property
    def arming_blockers(self) -> Sequence[str]:
        """The reasons why the devices cannot be armed, one sentence each; asked after the start."""
        return [
            f"{name}: {reason}"
            for name, driver in self._drivers.items()
            for reason in driver.preflight()
        ]

    @property
    def faults(self) -> Mapping[str, str]:
        """The failures since the start, by device, in order of occurrence."""
        return dict(self._faults)

    def start(self, timeout_s: float = OPEN_S) -> None:
        """Open all devices at once and run them.

        Raises:
            LinkError: a device cannot be reached, or is not open in time.
            ProtocolError: a device is not the one that the rig file names.
            DeviceError: a device reports a fault. If several fail, the message names them all.
        """
        self._loop = loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._turn, args=(loop,), name="slow devices", daemon=True
        )
        self._thread.start()
        try:
            self._call(self._open_all(timeout_s), timeout_s + BLOCKED_S)
        except FutureTimeoutError:
            self.stop()
            raise LinkError(
                f"the slow devices were not open within {timeout_s:g} s: a driver blocks the loop"
            ) from None
        except BaseException:
            self.stop()
            raise
        self._turned_ns = self._looked_ns = monotonic_ns()

    def poll(self) -> str | None:
        """Return why the run must end, or None; a reason stays."""
        if not self._faults and self._thread is not None:
            now = monotonic_ns()
            if now - self._looked_ns > AWAY_S * 1e9:
                self._turned_ns = now
            self._looked_ns = now
            if now - self._turned_ns > BLOCKED_S * 1e9:
                names = ", ".join(self._drivers)
                self._faults[""] = (
                    f"the loop of the slow devices ({names}) has been blocked for "
                    f"{BLOCKED_S:g} s by a driver"
                )
        return next(iter(self._faults.values()), None)

    def act(self, device: str, action: str, timeout_s: float = ACT_S) -> str:
        """Perform an action of a device, such as ``tare``; return the device's reply.

        Raises:
            DeviceError: it has no such action, refused it, or took longer than ``timeout_s``.
            LinkError: it cannot be reached.
            ProtocolError: its reply is invalid.
        """
        driver = self._drivers.get(device)
        if driver is None:
            known = ", ".join(self._drivers) or "none"
            raise DeviceError(f"unknown slow device {device!r}", hint=f"there are: {known}")
        actions = driver.declaration.actions
        if action not in actions:
            known = ", ".join(actions) or "nothing"
            raise DeviceError(f"{device} cannot do {action!r}", hint=f"its actions: {known}")
        if device not in self._running or device in self._faults:
            raise DeviceError(f"{device} does not run: {self._faults.get(device, 'not started')}")
        try:
            return self._call(asyncio.wait_for(driver.act(action), timeout_s), timeout_s + 1.0)
        except (TimeoutError, FutureTimeoutError):
            raise DeviceError(
                f"{device} did not complete the action {action} within {timeout_s:g} s"
            ) from None

    def stop(self) -> None:
        """Cancel and close all devices; failures are in :attr:`faults`. Idempotent."""
        loop, thread, self._thread = self._loop, self._thread, None
        if loop is None or thread is None:
            return
        try:
            ended = self._call(self._close_all(), 3 * CLOSE_S)
        except FutureTimeoutError:
            self._faults.setdefault("", "a slow device blocks its loop and could not be closed")
            ended = False
        self._loop = None
        if ended:  # else the thread stays blocked, and ends with the process
            loop.call_soon_threadsafe(loop.stop)
            thread.join()
            loop.close()

    def _turn(self, loop: asyncio.AbstractEventLoop) -> None:
        """Run the loop until it is stopped; the thread's only job."""
        asyncio.set_event_loop(loop)

        def mark() -> None:
            self._turned_ns = monotonic_ns()
            loop.call_later(_TURN_S, mark)

        loop.call_soon(mark)
        loop.run_forever()

    def _call(self, coroutine: Coroutine[Any, Any, T], timeout_s: float) -> T:
        if self._loop is None:
            coroutine.close()
            raise RuntimeError("the slow devices are not started")
        future = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        try:
            return future.result(timeout_s)
        except FutureTimeoutError:
            future.cancel()
            raise

    async def _open_all(self, timeout_s: float) -> None:
        async def open_device(name: str, driver: SlowDriver) -> RigdError | None:
            try:
                await asyncio.wait_for(driver.open(), timeout_s)
            except TimeoutError:
                return LinkError(f"{name} was not open within {timeout_s:g} s")
            except DEVICE_ERRORS as error:
                return type(error)(f"{name}: {error.message}", hint=error.hint)
            return None

        found = await asyncio.gather(*(open_device(*item) for item in self._drivers.items()))
        failed = [error for error in found if error is not None]
        if failed:
            hints = "; ".join(error.hint for error in failed if error.hint)
            message = "; ".join(error.message for error in failed)
            raise type(failed[0])(message, hint=hints or None)
        for name, driver in self._drivers.items():
            self._running[name] = asyncio.create_task(self._run(name, driver), name=name)

    async def _run(self, name: str, driver: SlowDriver) -> None:
        """Run one device; its failure is a fault of the run and does not affect other devices."""
        try:
            await driver.run(self._emitter(name))
            reason = "it stopped measuring by itself"
        except asyncio.CancelledError:
            task = asyncio.current_task()
            if task is None or task.cancelling():
                raise
            reason = "it cancelled itself"  # a cancellation of its own has escaped
        except DEVICE_ERRORS as error:
            reason = error.one_line
        except Exception as error:  # noqa: BLE001 - boundary: a bug of one driver ends the run well
            reason = f"its driver fails: {type(error).__name__}: {error}"
        self._faults.setdefault(name, f"{name}: {reason}")

    def _emitter(self, name: str) -> EmitRow:
        ring, slot = self._rings.get(name), self._slots[name]

        def emit(row: Sequence[float]) -> None:
            t_ns = monotonic_ns()
            slot.write(t_ns, row)
            if ring is not None:
                ring.push(t_ns + self._offset_ns, row)

        return emit

    async def _close_all(self) -> bool:
        """Cancel and close all at once; return whether all have ended."""
        ended = await asyncio.gather(*(self._close(*driver) for driver in self._drivers.items()))
        return all(ended)

    async def _close(self, name: str, driver: SlowDriver) -> bool:
        task, ended = self._running.pop(name, None), True
        if task is not None:
            task.cancel()
            await asyncio.wait([task], timeout=CLOSE_S)
            ended = task.done()
            if not ended:
                self._faults.setdefault(name, f"{name}: did not stop within {CLOSE_S:g} s")
        try:
            await asyncio.wait_for(driver.close(), CLOSE_S)
        except TimeoutError:
            self._faults.setdefault(name, f"{name}: was not closed within {CLOSE_S:g} s")
        except Exception as error:  # noqa: BLE001 - boundary: told, and the others are closed
            self._faults.setdefault(name, f"{name}: could not be closed: {error}")
        return ended
