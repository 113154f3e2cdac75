"""What has tripped is shown, and bars what follows, until a person has looked."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.daemon.serve.upkeep.trips import RememberedTrip, TripMemory
from rigd.engine.play.interlocks import Trip
from rigd.model.errors import RecordingError
from rigd.model.limits import Interlock
from rigd.model.severity import Severity
from rigd.record import NO_TRIAL, Event
from rigd.remote.protocol import Refusal


def trip(name: str, action: Severity, *, latch: bool = False, t_ns: int = 1) -> RememberedTrip:
    interlock = Interlock(name, "axis.position", high=1.0, action=action, latch=latch)
    return RememberedTrip.of(
        Trip(t_ns, interlock, 2.0, "axis.position 2 m is above 1 m", "too far")
    )


@pytest.mark.parametrize(
    ("action", "latch", "bars"),
    [
        (Severity.WARN, False, False),
        (Severity.WARN, True, True),
        (Severity.END_TRIAL, False, False),
        (Severity.STOP, False, True),
        (Severity.ESTOP, True, True),
    ],
)
def test_ending_or_latched_trip_bars_next_run(
    tmp_path: Path, action: Severity, latch: bool, bars: bool
) -> None:
    memory = TripMemory(tmp_path / "trips.json")
    memory.note([trip("far", action, latch=latch)])
    (view,) = memory.views()
    assert (view.latched, view.acknowledged) == (bars, False)
    assert view.message == "axis.position 2 m is above 1 m - too far"
    if bars:
        with pytest.raises(Refusal, match="far tripped"):
            memory.begin_run()
        memory.acknowledge("far", "alice")
    memory.begin_run()
    assert memory.views() == ()


def test_interlock_that_trips_again_must_be_acknowledged_again(tmp_path: Path) -> None:
    memory = TripMemory(tmp_path / "trips.json")
    memory.note([trip("far", Severity.STOP, t_ns=1)])
    memory.acknowledge("far", "alice")
    memory.note([trip("far", Severity.STOP, t_ns=2)])
    (view,) = memory.views()
    assert (view.since_ns, view.acknowledged) == (2, False)
    with pytest.raises(Refusal):
        memory.begin_run()


@pytest.mark.parametrize("rounding_ns", [-128, 0, 128])  # of a number in a browser
def test_acknowledgement_of_older_trip_is_refused(tmp_path: Path, rounding_ns: int) -> None:
    seen_ns = 1_790_000_000_000_000_000
    memory = TripMemory(tmp_path / "trips.json")
    memory.note([trip("far", Severity.STOP, t_ns=seen_ns + 5_000_000)])
    with pytest.raises(Refusal, match=r"far has tripped again since: axis\.position 2 m is above"):
        memory.acknowledge("far", "alice", seen_ns + rounding_ns)
    assert not memory.views()[0].acknowledged
    memory.acknowledge("far", "alice", seen_ns + 5_000_000 + rounding_ns)
    assert memory.views()[0].acknowledged


def test_untripped_interlock_cannot_be_acknowledged(tmp_path: Path) -> None:
    with pytest.raises(Refusal, match="nothing to acknowledge"):
        TripMemory(tmp_path / "trips.json").acknowledge("far", "alice")


def test_trips_survive_a_restart_of_the_daemon(tmp_path: Path) -> None:
    path = tmp_path / "trips.json"
    memory = TripMemory(path)
    memory.note([trip("far", Severity.STOP, t_ns=7), trip("hot", Severity.WARN, t_ns=5)])
    memory.save()
    again = TripMemory(path)
    assert again.views() == memory.views()
    assert again.known_ns == 7
    again.acknowledge("far", "alice")
    TripMemory(path).begin_run()


def test_trip_read_from_recording_is_the_same() -> None:
    known = trip("far", Severity.ABORT, latch=True, t_ns=9)
    data = {
        "name": "far", "action": "abort", "priority": "medium", "latched": True, "value": 2.0,
        "reason": "axis.position 2 m is above 1 m", "message": "too far",
    }  # fmt: skip
    assert RememberedTrip.recorded(Event(9, "interlock", NO_TRIAL, data)) == known


def test_invalid_trip_file_is_not_read_as_empty(tmp_path: Path) -> None:
    path = tmp_path / "trips.json"
    path.write_text('{"known_ns": 1, "trips": [{"interlock": "far"}]}')
    with pytest.raises(RecordingError, match="is no list of trips"):
        TripMemory(path)
