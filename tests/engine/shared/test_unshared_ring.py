"""Rows come out of the ring as they went in; a full ring drops new rows and counts them."""

from __future__ import annotations

from rigd.engine.shared import RowRing
from rigd.model.channels import Channel, Stream

STREAM = Stream("s", (Channel("a"), Channel("b", "A")), has_status=True)


def test_rows_keep_order_and_values_across_the_wrap() -> None:
    ring = RowRing.unshared(STREAM, 4)
    seen: list[object] = []
    for t in range(10):
        ring.push(t, (t + 0.5, -t, t % 3))
        if t % 3 == 2:
            seen += ring.drain().tolist()
    seen += ring.drain().tolist()
    assert seen == [(t, t + 0.5, -float(t), t % 3) for t in range(10)]
    assert ring.overruns == 0


def test_full_ring_keeps_rows_and_counts_lost_ones() -> None:
    ring = RowRing.unshared(STREAM, 3)
    for t in range(5):
        ring.push(t, (0.0, 0.0, 0))
    assert ring.fill == 1.0
    assert ring.overruns == 2
    assert ring.drain()["t_ns"].tolist() == [0, 1, 2]
    assert ring.fill == 0.0


def test_drained_rows_do_not_change_with_later_writes() -> None:
    ring = RowRing.unshared(STREAM, 2)
    ring.push(1, (1.0, 1.0, 0))
    rows = ring.drain()
    ring.push(2, (2.0, 2.0, 0))
    ring.push(3, (3.0, 3.0, 0))
    assert rows["a"].tolist() == [1.0]
