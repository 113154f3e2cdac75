"""A lease is kept on a busy computer: renewals go out by a clock, whatever became of the last."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from typing import cast

import pytest
from support.daemon.virtual_loop import VirtualLoop, in_virtual_time

from rigd.model.errors import LinkError, RigdError
from rigd.remote.client.lease.renewing import renew_until_lost
from rigd.remote.protocol import ClientUser, Refusal
from rigd.remote.server.lease import Lease

ALICE = ClientUser.of("alice")
#: A client without a reply gives up a request after this, in s: two attempts.
PATIENCE_S = 4.0


@dataclass
class Link:
    """A lease behind a link on which requests are lost from time to time."""

    lost: tuple[float, float] = (0.0, 0.0)  #: from when to when, s
    replies_lost: bool = False  #: the requests arrive, the replies do not
    arrived: list[float] = field(default_factory=list)
    failures: list[RigdError] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.loop = cast(VirtualLoop, asyncio.get_running_loop())
        self.lease = Lease(clock=lambda: round(self.loop.time() * 1e9))
        self.lease.take(ALICE)

    async def renew(self) -> None:
        is_lost = self.lost[0] <= self.loop.time() < self.lost[1]
        if self.replies_lost or not is_lost:
            self.arrived.append(self.loop.time())
            self.lease.renew(ALICE)
        if is_lost:
            await asyncio.sleep(PATIENCE_S)
            raise LinkError("no reply")

    async def keep(self, for_s: float) -> Refusal | None:
        """Renew for so long; return the refusal if the lease was lost."""
        task = asyncio.create_task(renew_until_lost(self.renew, self.failures.append))
        await asyncio.wait([task], timeout=for_s)
        if task.done():
            return task.result()
        task.cancel()
        return None


@pytest.mark.parametrize("replies_lost", [False, True])
def test_lease_outlives_four_lost_renewals(replies_lost: bool) -> None:
    async def keep() -> Link:
        link = Link((2.5, 6.5), replies_lost)
        assert await link.keep(20.0) is None
        return link

    link = in_virtual_time(keep())
    assert link.lease.lost() == ()
    assert len(link.failures) <= 1
    assert max(b - a for a, b in zip(link.arrived, link.arrived[1:], strict=False)) < 6.0


def test_slow_replies_delay_no_renewal() -> None:
    async def keep() -> list[float]:
        link = Link((0.0, 100.0), replies_lost=True)
        await link.keep(10.5)
        return link.arrived

    assert in_virtual_time(keep()) == [float(item) for item in range(1, 11)]


def test_delayed_process_renews_at_once() -> None:
    async def keep() -> Link:
        link = Link()
        link.loop.call_at(2.5, lambda: setattr(link.loop, "now", 7.9))  # it was kept waiting
        assert await link.keep(9.5) is None
        return link

    link = in_virtual_time(keep())
    assert link.arrived == [1.0, 2.0, 7.9, 8.0, 9.0]
    assert link.lease.lost() == ()


def test_renewal_ends_when_another_holds_it() -> None:
    async def keep() -> Refusal | None:
        link = Link()
        link.loop.call_at(3.5, lambda: link.lease.seize(ClientUser.of("carol")))
        refusal = await link.keep(20.0)
        assert len(link.arrived) == 4
        return refusal

    refusal = in_virtual_time(keep())
    assert refusal is not None and "carol" in refusal.message
