"""Events without gaps, and how a run ended."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator, Sequence

import pytest

from rigd.model.errors import LinkError
from rigd.remote.client.watching import RunWatch, without_gaps
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


def test_what_was_lost_on_the_way_is_asked_for() -> None:
    told = [event(seq) for seq in range(8)]
    assert read([told[2], told[5], told[6]], told, None) == told[2:7]


def test_from_a_number_on_the_known_come_first_and_none_twice() -> None:
    told = [event(seq) for seq in range(8)]
    assert read(told[4:], told[:6], 3) == told[3:]


def test_what_the_daemon_has_forgotten_stays_a_gap() -> None:
    told = [event(seq) for seq in range(8)]
    assert [item.seq for item in read([told[1], told[7]], told[5:], None)] == [1, 5, 6, 7]


def test_a_daemon_that_was_started_anew_counts_from_the_start() -> None:
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
        v=VERSION, rig="r", title="", t_ns=round(t_s * 1e9), seq=0,
        daemon=Daemon(version="", pid=1, started_ns=0),
        state="idle" if run is None else "running", run=run, last=last, interrupted=interrupted,
    )  # fmt: skip


def test_a_run_has_ended_once_it_is_the_last() -> None:
    watch = RunWatch(RUN)
    assert watch.ended(status(0.0, run=RUN)) is None
    assert watch.ended(status(0.1, run=RUN)) is None
    assert watch.ended(status(0.2, last=ENDED)) == ENDED


def test_how_an_interrupted_run_ended_before_is_not_how_it_ends() -> None:
    watch = RunWatch(RUN)
    assert watch.ended(status(0.0, last=ENDED)) is None  # from before it went on
    assert watch.ended(status(0.1, run=RUN, last=ENDED)) is None
    assert watch.ended(status(0.2, last=ENDED)) == ENDED


def test_a_run_too_short_to_be_seen_has_ended_all_the_same() -> None:
    watch = RunWatch(RUN)
    assert watch.ended(status(0.0, last=ENDED)) is None
    assert watch.ended(status(1.5, last=ENDED)) == ENDED


@pytest.mark.parametrize("run", [None, "b.mcap"])
def test_a_run_of_which_nothing_is_known_is_not_waited_for(run: str | None) -> None:
    watch = RunWatch(RUN)
    other = LastRun(run="c.mcap", ending="complete", reason="all done", exit_code=0)
    assert watch.ended(status(0.0, run=run, last=other)) is None  # may be from before it began
    with pytest.raises(Refusal, match=r"a\.mcap is not under way"):
        watch.ended(status(1.5, run=run, last=other))
    assert watch.ended(status(2.0, run=run, last=ENDED)) == ENDED


def test_a_daemon_that_died_with_the_run_is_told() -> None:
    watch = RunWatch(RUN)
    left = (Interrupted(run=RUN, reason="", trials_done=1, trials_total=3),)
    assert watch.ended(status(0.0, run=RUN)) is None
    with pytest.raises(LinkError, match="was started anew"):
        watch.ended(status(5.0, interrupted=left))
