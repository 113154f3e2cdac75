"""An interlock that compares a value with its setpoint sees a drive that does not follow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import pytest
from support.engine.bench import Bench, move, procedure
from support.recordings.shipped_runs import Pair, play

from rigd.config.loader import load_rig
from rigd.engine.play.interlocks import InterlockBank, Trip
from rigd.model.errors import Exit
from rigd.model.limits import Interlock
from rigd.model.severity import Severity
from rigd.sdk.shipped_files import shipped_folder
from rigd_sim.lugre.belt import BeltRow, LugreBelt

MS: Final = 1_000_000
FOLLOWS: Final = Interlock(
    "follows", "a.speed", follows="a.speed", band=0.1, delay_s=0.003, action=Severity.ABORT
)
CLUTCHED: Final = Interlock(
    "follows", "a.speed", follows="a.speed", band=0.1, delay_s=0.003, only_while="a.engaged"
)


def feed(
    interlock: Interlock, rows: Sequence[tuple[float, float]], engaged: float = 1.0
) -> list[Trip]:
    """Return the trips after rows of measured speed and setpoint, 1 ms apart."""
    bank = InterlockBank(
        [interlock], {"a.speed": 0}, {"a.speed": "m/s"}, [0], {"a.speed": 0, "a.engaged": 1}
    )
    trips: list[Trip] = []
    for k, (speed, setpoint) in enumerate(rows):
        trips += bank.check(k * MS, [speed], [k * MS], [setpoint, engaged])
    return trips


def test_value_apart_from_setpoint_trips_after_delay() -> None:
    (trip,) = feed(FOLLOWS, [(0.0, 0.3)] * 4)
    assert trip.t_ns == 3 * MS
    assert trip.reason == (
        "a.speed 0 m/s does not follow its setpoint 0.3 m/s: more than 0.1 m/s apart for 0.003 s"
    )
    assert feed(FOLLOWS, [(0.3, 0.0)] * 4)  # that it goes on when asked to stop


def test_lag_within_band_or_delay_trips_nothing() -> None:
    assert not feed(FOLLOWS, [(0.29, 0.3)] * 50)
    assert not feed(FOLLOWS, [(0.0, 0.3), (0.1, 0.3), (0.15, 0.3), *[(0.25, 0.3)] * 25] * 10)
    ramp = [(0.001 * max(k - 50, 0), 0.001 * k) for k in range(400)]
    assert not feed(FOLLOWS, ramp)


def test_open_monitor_that_picks_up_mains_trips() -> None:
    mains = [0.5 * math.sin(2 * math.pi * 0.05 * k) for k in range(400)]
    (trip,) = feed(replace(FOLLOWS, delay_s=0.2), [(value, 0.0) for value in mains])
    assert trip.t_ns >= 200 * MS
    brief = [(0.5 if k % 100 < 50 else 0.0, 0.0) for k in range(400)]
    assert not feed(replace(FOLLOWS, delay_s=0.2), brief)


def test_released_clutch_lets_value_differ_from_setpoint() -> None:
    assert not feed(CLUTCHED, [(2.0, 0.0)] * 50, engaged=0.0)
    assert feed(CLUTCHED, [(2.0, 0.0)] * 50, engaged=1.0)
    assert feed(CLUTCHED, [(float("nan"), 0.0)], engaged=0.0)  # a value must come all the same


def test_drive_that_stands_still_ends_the_run() -> None:
    bench = Bench(
        interlocks=(
            Interlock(
                "axis_follows", "axis.load", follows="axis.speed", band=0.1, delay_s=0.05,
                action=Severity.ABORT,
            ),
        )
    )  # fmt: skip
    bench.axis.answer = lambda t_ns: (0.0, 0.0)  # its speed, for this test, is in `load`
    result = bench.run(procedure([move("one", 0.5)])).execute()
    assert (result.ending, result.exit_code) == ("aborted", Exit.TRIPPED)
    assert "axis_follows: axis.load 0 N does not follow its setpoint" in result.reason
    assert bench.axis.safe_calls


RIGS = sorted(shipped_folder("configs").glob("*lugre.yaml"))


@pytest.mark.parametrize("path", RIGS, ids=lambda path: path.stem)
def test_every_drive_of_shipped_rigs_is_supervised(path: Path) -> None:
    rig = load_rig(path)
    followed = {item.follows: item for item in rig.interlocks if item.follows is not None}
    driven = {"wheel_servo.current", "longitudinal_belt.speed", "lateral_belt.speed"}
    assert followed.keys() == {item for item in driven if item.partition(".")[0] in rig.devices}
    assert all(item.action >= Severity.ABORT for item in followed.values())


def test_blocked_belt_aborts_shipped_procedure(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    reading = LugreBelt.read

    def blocked(belt: LugreBelt, t_ns: int) -> BeltRow:
        row = reading(belt, t_ns)
        return BeltRow.of(position=row.position, speed=0.0, force=row.force, status=int(row.status))

    monkeypatch.setattr(LugreBelt, "read", blocked)
    pair = Pair(shipped_folder("procedures") / "quick.yaml", load_rig("lugre-1"))
    result = play(pair, 1, tmp_path / "run.mcap", trials=1)
    assert result.exit_code is Exit.TRIPPED
    assert "longitudinal_belt.speed 0 m/s does not follow its setpoint" in result.reason
