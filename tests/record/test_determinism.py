"""The bytes of a closed file follow from what was given, not from when it was flushed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rigd.model import Stream
from rigd.record import RecordingWriter

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    calls=st.lists(
        st.tuples(st.sampled_from(["wheel_servo", "force", "event"]), st.integers(1, 900)),
        max_size=25,
    ),
    flushed=st.lists(st.booleans(), min_size=25, max_size=25),
    rate_hz=st.sampled_from([20.0, 1000.0, 50_000.0]),
)
def test_flushes_leave_no_trace(
    create: Create,
    rows: MakeRows,
    servo: Stream,
    force: Stream,
    start_ns: int,
    tmp_path: Path,
    calls: list[tuple[str, int]],
    flushed: list[bool],
    rate_hz: float,
) -> None:
    pool = {stream.name: rows(stream, 25 * 900, rate_hz=rate_hz) for stream in (servo, force)}
    for path in tmp_path.iterdir():
        path.unlink()
    for name, flushes in (("never.mcap", [False] * 25), ("some.mcap", flushed)):
        position = {"wheel_servo": 0, "force": 0}
        with create(name) as writer:
            for (what, count), flush in zip(calls, flushes, strict=False):
                if what == "event":
                    writer.event(start_ns + count, "step", data={"name": "x" * count})
                else:
                    at = position[what]
                    writer.write(what, pool[what][at : at + count])
                    position[what] += count
                if flush:
                    writer.flush()
    assert (tmp_path / "never.mcap").read_bytes() == (tmp_path / "some.mcap").read_bytes()


def test_rows_may_come_in_any_portions(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    pool = rows(servo, 60_000, rate_hz=9600.0)
    for name, portion in (("few.mcap", 60_000), ("many.mcap", 37)):
        with create(name) as writer:
            for start in range(0, len(pool), portion):
                writer.write("wheel_servo", pool[start : start + portion])
    assert (tmp_path / "few.mcap").read_bytes() == (tmp_path / "many.mcap").read_bytes()
