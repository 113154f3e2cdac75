"""Points bound what they stand for, exactly."""

from __future__ import annotations

import numpy as np
import pytest

from rigd.daemon.live.points import Points
from rigd.engine.sink import Rows
from rigd.model import Channel, Stream
from rigd.model.rows import row_dtype

STREAM = Stream("s", (Channel("a"), Channel("b", "A"), Channel("c")), has_status=True)


def rows(count: int, seed: int = 1, holes: float = 0.0) -> Rows:
    draw = np.random.default_rng(seed)
    made = np.zeros(count, row_dtype(STREAM))
    made["t_ns"] = 10**18 + np.cumsum(draw.integers(1, 10**6, count))
    for channel in STREAM.channels:
        made[channel.name] = draw.normal(size=count)
        made[channel.name][draw.random(count) < holes] = np.nan
    made["status"] = 0xFFFFFFFF
    return made


def test_rows_become_points_with_values_in_their_place() -> None:
    made = rows(5)
    points = Points.of(STREAM, made[::2])
    assert points.times_ns.tolist() == made["t_ns"][::2].tolist()
    for index, channel in enumerate(STREAM.channels):
        assert points.low[:, index].tolist() == made[channel.name][::2].tolist()
    made["a"] = 0.0
    assert points.high[0, 0] != 0.0  # a copy


@pytest.mark.parametrize("count", [1, 2, 59, 60, 61, 62, 119, 120, 121, 320, 5000])
@pytest.mark.parametrize("most", [2, 3, 60])
def test_point_bounds_all_rows_since_one_before(count: int, most: int) -> None:
    made = rows(count, seed=count)
    points = Points.of(STREAM, made).reduced(most)
    assert len(points) == min(count, most)
    since = -1
    for number, time_ns in enumerate(points.times_ns):
        stands_for = made[(made["t_ns"] > since) & (made["t_ns"] <= time_ns)]
        assert len(stands_for) > 0
        for index, channel in enumerate(STREAM.channels):
            assert points.low[number, index] == stands_for[channel.name].min()
            assert points.high[number, index] == stands_for[channel.name].max()
        since = time_ns
    assert since == made["t_ns"][-1]
    assert points.low[-1].tolist() == [made[item.name][-1] for item in STREAM.channels]
    assert points.high[-1].tolist() == points.low[-1].tolist()


def test_nan_hides_no_value_beside_it() -> None:
    made = rows(200, holes=0.5)
    made["b"] = np.nan
    points = Points.of(STREAM, made).reduced(3)
    assert points.low[0, 0] == np.nanmin(made["a"][:100])
    assert np.isnan(points.low[:, 1]).all() and np.isnan(points.high[:, 1]).all()
    made["c"][50] = np.inf
    assert Points.of(STREAM, made).reduced(2).high[0, 2] == np.inf


def test_points_reduced_twice_have_equal_bounds() -> None:
    parts = [Points.of(STREAM, rows(300, seed)).reduced(40) for seed in range(5)]
    whole = Points.joined(parts).reduced(7)
    assert whole.low.min(axis=0).tolist() == [
        min(rows(300, seed)[channel.name].min() for seed in range(5)) for channel in STREAM.channels
    ]
