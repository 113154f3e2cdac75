"""Renews the control lease (the right to command a rig) by a fixed clock."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

from rigd.model.errors import LinkError, RigdError
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.limits import LEASE_S, RENEW_S


async def renew_until_lost(
    renew: Callable[[], Awaitable[object]], failed: Callable[[RigdError], None]
) -> Refusal:
    """Call ``renew`` every :data:`RENEW_S` until another client has the lease; return that refusal.

    An attempt that waits for its reply delays none after it: on a busy computer a reply may take
    longer than the lease lasts, and each request that arrives renews it. ``failed`` gets the error
    of an attempt that failed otherwise, but only the first of several in a row.
    """
    loop = asyncio.get_running_loop()
    lost: asyncio.Future[Refusal] = loop.create_future()
    attempts: set[asyncio.Task[None]] = set()
    succeeded = 0  #: the newest attempt that did
    has_failed = False

    async def attempt(number: int) -> None:
        nonlocal has_failed, succeeded
        error: RigdError
        try:
            async with asyncio.timeout(LEASE_S):
                await renew()
        except TimeoutError:
            error = LinkError(f"no reply within {LEASE_S:g} s")
        except Refusal as refusal:
            error = refusal
            if refusal.code is Code.NO_LEASE and not lost.done():
                lost.set_result(refusal)
        except RigdError as other:
            error = other
        else:
            succeeded, has_failed = max(succeeded, number), False
            return
        if number > succeeded and not lost.done():
            if not has_failed:
                failed(error)
            has_failed = True

    number, at_s = 0, loop.time()
    try:
        while True:
            number, at_s = number + 1, at_s + RENEW_S
            await asyncio.wait([lost], timeout=max(0.0, at_s - loop.time()))
            if lost.done():
                return lost.result()
            late_s = max(0.0, loop.time() - at_s)  # of those that it missed, one is enough
            at_s += late_s // RENEW_S * RENEW_S
            task = loop.create_task(attempt(number), name="renewal")
            attempts.add(task)
            task.add_done_callback(attempts.discard)
    finally:
        for task in attempts:
            task.cancel()
