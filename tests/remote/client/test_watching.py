"""Events without gaps, and how a run ended."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Sequence

import pytest

from rigd.model.errors import LinkError
from rigd.remote.client.watching import RunWatch, all_events, without_gaps
from rigd.remote.protocol import VERSION, Refusal, RigEvent, Status
from rigd.remote.protocol.results import Events
from rigd.remote.protocol.status import Daemon, Interrupted, LastRun

RUN = "a.mcap"
ENDED = LastRun(run=RUN, ending="complete", reason="all done", exit_code=0)


def event(seq: int, t_ns: int | None = None) -> RigEvent:
    return RigEvent(v=VERSION, seq=seq, t_ns=seq if t_ns is None else t_ns, kind="step")


def read(heard: Sequence[RigEvent], known: Sequence[RigEvent], since: int | None) -> list[RigEvent]:
    async def hear() -> AsyncGenerator[RigEvent, None]:
        for item in heard:
            yield item

    async def ask(seq: int) -> Events:
        return Events(events=tuple(item for item in known if item.seq >= seq), next=0)

    async def collect() -> list[RigEvent]:
        return [without_gap async for without_gap in without_gaps(hear(), ask, since)]

    return asyncio.run(collect())


def test_lost_events_are_requested_again() -> None:
    told = [event(seq) for seq in range(8)]
    assert read([told[2], told[5], told[6]], told, None) == told[2:7]


def test_known_events_come_first_and_none_twice() -> None:
    told = [event(seq) for seq in range(8)]
    assert read(told[4:], told[:6], 3) == told[3:]


def test_forgotten_events_stay_a_gap() -> None:
    told = [event(seq) for seq in range(8)]
    assert [item.seq for item in read([told[1], told[7]], told[5:], None)] == [1, 5, 6, 7]


def test_known_events_of_unordered_times_come_once() -> None:
    told = [event(0, 1), event(1, 5), event(2, 3), event(3, 6)]
    assert read(told[1:], told[:3], 0) == told


def test_events_that_never_end_are_returned() -> None:
    async def ask(seq: int) -> Events:
        return Events(events=(event(seq),), next=seq + 1)

    found = asyncio.run(all_events(ask, 7))
    assert [item.seq for item in found.events] == list(range(7, found.next))


def test_restarted_daemon_counts_from_zero() -> None:
    new = [event(0, 100), event(1, 101)]
    assert read([event(40), event(41), *new], [], None) == [event(40), event(41), *new]


def status(
    t_s: float,
    *,
    run: str | None = None,
    last: LastRun | None = None,
    interrupted: tuple[Interrupted, ...] = (),
) -> Status:
    return Status(
        v=VERSION, rig="r", title="", t_ns=round(t_s * 1e9), rows_ns=0, seq=0,
        daemon=Daemon(version="", pid=1, started_ns=0),
        state="idle" if run is None else "running", run=run, last=last, interrupted=interrupted,
    )  # fmt: skip


def test_run_has_ended_once_it_is_last() -> None:
    watch = RunWatch(RUN)
    assert watch.ended(status(0.0, run=RUN)) is None
    assert watch.ended(status(0.1, run=RUN)) is None
    assert watch.ended(status(0.2, last=ENDED)) == ENDED


def test_earlier_end_of_resumed_run_is_not_final() -> None:
    watch = RunWatch(RUN)
    assert watch.ended(status(0.0, last=ENDED)) is None  # from before it went on
    assert watch.ended(status(0.1, run=RUN, last=ENDED)) is None
    assert watch.ended(status(0.2, last=ENDED)) == ENDED


def test_run_too_short_to_observe_has_ended_too() -> None:
    watch = RunWatch(RUN)
    assert watch.ended(status(0.0, last=ENDED)) is None
    assert watch.ended(status(1.5, last=ENDED)) == ENDED


@pytest.mark.parametrize("run", [None, "b.mcap"])
def test_unknown_run_is_not_waited_for(run: str | None) -> None:
    watch = RunWatch(RUN)
    other = LastRun(run="c.mcap", ending="complete", reason="all done", exit_code=0)
    assert watch.ended(status(0.0, run=run, last=other)) is None  # may be from before it began
    with pytest.raises(Refusal, match=r"a\.mcap is not under way"):
        watch.ended(status(1.5, run=run, last=other))
    assert watch.ended(status(2.0, run=run, last=ENDED)) == ENDED


def test_daemon_that_died_with_run_is_reported() -> None:
    watch = RunWatch(RUN)
    left = (Interrupted(run=RUN, reason="", trials_done=1, trials_total=3),)
    assert watch.ended(status(0.0, run=RUN)) is None
    with pytest.raises(LinkError, match="restarted"):
        watch.ended(status(5.0, interrupted=left))
