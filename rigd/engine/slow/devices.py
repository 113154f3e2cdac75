"""Runs the drivers of slow devices as coroutines on one event loop, in a thread of the daemon.

A slow device needs longer than a cycle to respond. One that takes setpoints has a second coroutine,
which obeys the newest order of the cycle: see :mod:`rigd.engine.slow.orders`.
"""

from __future__ import annotations

import asyncio
import math
import threading
from collections.abc import Callable, Collection, Coroutine, Mapping, Sequence
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import Any, Final, Protocol, TypeVar

from rigd.engine.clock import monotonic_ns
from rigd.engine.cycle.cycle import DEVICE_ERRORS
from rigd.engine.slow.orders import DeviceOrders, Done, Order
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
#: How often the newest order of the cycle is looked at.
ORDER_S: Final = 0.02
#: Longest time for a device to take its setpoints, or to be enabled.
WRITE_S: Final = 2.0
#: Longest time for a device to be safe.
SAFE_S: Final = 3.0
#: A device that was enabled is made safe if the cycle gives no order for this time; the daemon
#: kills a silent cycle sooner.
UNORDERED_S: Final = 1.0
#: How often opening and proofs look whether a stop is requested.
_STOP_S: Final = 0.05
#: More than its own bound until the watchdog of a device must have acted.
PROOF_S: Final = 5.0

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
        orders: of the cycle, for each device that takes setpoints.
        stopped: whether a stop is requested, which ends opening and proofs.
    """

    def __init__(
        self,
        drivers: Mapping[str, SlowDriver],
        *,
        rings: Mapping[str, SlowRowSink],
        slots: Mapping[str, Slot],
        start_ns: int,
        origin_ns: int,
        orders: Mapping[str, DeviceOrders] | None = None,
        stopped: Callable[[], bool] = lambda: False,
    ) -> None:
        self._drivers = dict(drivers)
        self._rings = rings
        self._slots = slots
        self._offset_ns = start_ns - origin_ns
        self._faults: dict[str, str] = {}  # by device, in order of occurrence
        self._loop: asyncio.AbstractEventLoop | None = None  # while it runs
        self._thread: threading.Thread | None = None
        self._running: dict[str, asyncio.Task[None]] = {}
        self._orders = dict(orders or {})
        self._stopped = stopped
        self._obeying: dict[str, asyncio.Task[None]] = {}
        self._making_safe: set[str] = set()
        self._unsafe: dict[str, str] = {}  # open devices that were not made safe, and why
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

    @property
    def acting(self) -> Collection[str]:
        """The names of the devices that take setpoints."""
        return self._orders.keys()

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
            self._unless_stopped(self._open_all(timeout_s), timeout_s + BLOCKED_S)
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

    def prove_watchdogs(self) -> tuple[Mapping[str, float], Sequence[str]]:
        """Test each watchdog that a device declares.

        Returns:
            After how many seconds each device was safe; why one is not proven, a sentence each.
        """
        found: dict[str, float] = {}
        reasons = []
        for name in self._orders:
            driver = self._drivers[name]
            bound_s = driver.declaration.watchdog_s
            if bound_s is None:
                continue
            limit_s = bound_s + PROOF_S
            try:
                found[name] = self._unless_stopped(
                    asyncio.wait_for(driver.prove_watchdog(), limit_s), limit_s + 1.0
                )
            except (TimeoutError, FutureTimeoutError):
                reasons.append(f"{name}: its watchdog did not act within {limit_s:g} s")
            except DEVICE_ERRORS as error:
                reasons.append(f"{name}: its watchdog is not proven: {error}")
        return found, reasons

    def make_safe(self) -> Sequence[str]:
        """Make every open device that takes setpoints safe; return the problems, a sentence each.

        They take no setpoints after that. A device that is safe already is left alone.
        """
        if self._loop is None:
            return ()
        try:
            return self._call(self._make_all_safe(), 2 * SAFE_S)
        except FutureTimeoutError:
            return [f"{', '.join(self._unsafe)} could not be made safe: a driver blocks the loop"]

    def stop(self) -> None:
        """Cancel and close all devices; failures are in :attr:`faults`. Idempotent."""
        loop, thread, self._thread = self._loop, self._thread, None
        if loop is None or thread is None:
            return
        try:
            ended = self._call(self._close_all(), 3 * CLOSE_S + 2 * SAFE_S)
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

    def _unless_stopped(self, coroutine: Coroutine[Any, Any, T], timeout_s: float) -> T:
        """Call as :meth:`_call` does, until a stop is requested.

        Raises:
            DeviceError: it is requested; the coroutine is cancelled.
        """

        async def watched() -> T:
            task = asyncio.ensure_future(coroutine)
            try:
                while not (await asyncio.wait((task,), timeout=_STOP_S))[0]:
                    if self._stopped():
                        raise DeviceError("a stop was requested")
                return task.result()
            finally:
                if not task.done():
                    task.cancel()
                    await asyncio.wait((task,))

        return self._call(watched(), timeout_s)

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
        for name, orders in self._orders.items():
            self._unsafe[name] = "it was not asked yet"
            obeying = self._obey(name, self._drivers[name], orders)
            self._obeying[name] = asyncio.create_task(obeying, name=f"{name} obeys")

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

    async def _obey(self, name: str, driver: SlowDriver, orders: DeviceOrders) -> None:
        """Do what the cycle orders, at the pace of the device, until it orders to be safe."""
        reason = ""
        try:
            t_ns, order, setpoints = await _enabling(orders)
            written: list[float] | None = None
            while order is not Order.SAFE:
                if monotonic_ns() - t_ns > UNORDERED_S * 1e9:
                    reason = f"the cycle gave it no setpoint for {UNORDERED_S:g} s"
                    break
                if setpoints != written:
                    await asyncio.wait_for(driver.write(setpoints), WRITE_S)
                    if written is None:
                        await asyncio.wait_for(driver.arm(), WRITE_S)
                        orders.report(Done.ARMED)
                    written = setpoints
                await asyncio.sleep(ORDER_S)
                # An order in writing is none, also that of a cycle that was killed meanwhile.
                t_ns, order, setpoints = orders.given() or (t_ns, order, setpoints)
        except TimeoutError:
            reason = f"it did not take its setpoints within {WRITE_S:g} s"
        except DEVICE_ERRORS as error:
            reason = error.one_line
        except Exception as error:  # noqa: BLE001 - boundary: a bug of one driver ends the run well
            reason = f"its driver fails: {type(error).__name__}: {error}"
        if reason:
            self._faults.setdefault(name, f"{name}: {reason}")
        await self._make_one_safe(name)

    async def _make_all_safe(self) -> Sequence[str]:
        """Make all safe at once, those first that obey; return why some are not."""
        under_way = {
            name
            for name, task in self._obeying.items()
            if name in self._making_safe and not task.done()
        }
        for name, task in self._obeying.items():
            if name not in under_way:
                task.cancel()
        if self._obeying:
            await asyncio.wait(self._obeying.values(), timeout=SAFE_S)
        self._obeying.clear()
        waiting = [name for name in self._unsafe if name not in under_way]
        await asyncio.gather(*(self._make_one_safe(name) for name in waiting))
        return [f"{name} could not be made safe: {why}" for name, why in self._unsafe.items()]

    async def _make_one_safe(self, name: str) -> None:
        if name not in self._unsafe:
            return
        self._making_safe.add(name)
        try:
            await asyncio.wait_for(self._drivers[name].make_safe(), SAFE_S)
        except TimeoutError:
            self._unsafe[name] = f"it did not answer within {SAFE_S:g} s"
        except DEVICE_ERRORS as error:
            self._unsafe[name] = error.one_line
        except Exception as error:  # noqa: BLE001 - boundary: told, and the others go on
            self._unsafe[name] = f"its driver fails: {type(error).__name__}: {error}"
        else:
            self._unsafe.pop(name, None)
            self._orders[name].report(Done.SAFE)

    def _emitter(self, name: str) -> EmitRow:
        ring, slot = self._rings.get(name), self._slots[name]
        orders, has_status = self._orders.get(name), self._drivers[name].declaration.has_status
        unknown = [math.nan] * len(self._drivers[name].declaration.setpoints)

        def emit(row: Sequence[float]) -> None:
            t_ns = monotonic_ns()
            slot.write(t_ns, row)
            if ring is None:
                return
            if orders is not None:  # recorded between values and status, as those of fast devices
                given = orders.given()
                setpoints = unknown if given is None else given[2]
                end = len(row) - has_status
                row = (*row[:end], *setpoints, *row[end:])
            ring.push(t_ns + self._offset_ns, row)

        return emit

    async def _close_all(self) -> bool:
        """Make safe, cancel and close all at once; return whether all have ended."""
        for problem in await self._make_all_safe():
            self._faults.setdefault(problem.partition(" ")[0], problem)
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


async def _enabling(orders: DeviceOrders) -> tuple[int, Order, list[float]]:
    """Wait for the first order that is not to wait; return it."""
    while (found := orders.given()) is None or found[1] is Order.WAIT:
        await asyncio.sleep(ORDER_S)
    return found
