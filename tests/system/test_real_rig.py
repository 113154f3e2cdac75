"""What a rig of real devices is protected from, and what moving it by hand does."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.commands.command import rigd, start
from support.wire import write_rig

from rigd.record import Recording


def test_a_dry_run_never_opens_devices(tmp_path: Path) -> None:
    rig = write_rig(tmp_path, "wire-dry").rig  # its devices are not there
    done = rigd("run", "quick", "--rig", rig, "--dry-run", cwd=tmp_path)
    assert done.code == 0, done.err
    assert "played on the plant of the sibling lugre-1" in done.out
    assert "interlock overrun_far, stale after" in done.out
    assert "fit to run" in done.out
    assert not (tmp_path / "runs").exists()


def test_dry_run_without_sibling_states_no_peaks(tmp_path: Path) -> None:
    rig = write_rig(tmp_path, "wire-alone").rig
    rig.write_text(rig.read_text().replace("sibling: sim_lugre.yaml", ""))
    done = rigd("run", "quick", "--rig", rig, "--dry-run", cwd=tmp_path)
    assert done.code == 0, done.err
    assert "without physics: no peak is known" in done.out
    assert "predicted peaks" not in done.out
    assert "at most 10.00" in done.out
    assert "fit to run" not in done.out
    found = rigd("run", "quick", "--rig", rig, "--dry-run", "--json", cwd=tmp_path).json
    assert (found["physics"], found["peaks"], found["fit"]) == ("none", [], True)
    assert found["known_s"] < found["duration_s"]


@pytest.mark.parametrize("option", [("--pace", "2"), ("--start", "2026-11-21T08:00:00")])
def test_virtual_time_is_refused_on_real_devices(tmp_path: Path, option: tuple[str, str]) -> None:
    rig = write_rig(tmp_path, "wire-pace").rig
    done = rigd("run", "quick", "--rig", rig, *option, cwd=tmp_path)
    assert done.code == 2
    assert "its devices run in real time" in done.err


def test_rig_without_devices_is_blocked_with_the_reason(tmp_path: Path) -> None:
    rig = write_rig(tmp_path, "wire-dead").rig
    done = rigd("run", "quick", "--rig", rig, cwd=tmp_path)
    assert done.code == 3
    assert "no simulated CAN bus at" in done.err
    assert "no NI gRPC Device Server answers" in done.err
    assert "there is no serial port" in done.err
    assert not list((tmp_path / "runs").glob("*.mcap"))


def test_jog_holds_setpoint_then_rests_and_is_recorded(tmp_path: Path) -> None:
    done = rigd(
        "jog", "wheel_servo.current=0.3A", "longitudinal_belt.engaged=0", "--for", "2 s",
        "--rig", "lugre-1", "--json", cwd=tmp_path,
    )  # fmt: skip
    # A stall of 50 ms is 2 % of it; 10 % of missed cycles make a run incomplete.
    assert done.code == 0, done.err
    recording = Recording.open(tmp_path / done.json["recording"])
    rows = recording.read("wheel_servo")
    held = rows["current_setpoint"] == 0.3
    late = (event for event in recording.events() if event.kind == "late")
    missed = sum(int(item.data["missed_slots"]) for item in late)
    # Every cycle that was not missed held it, and the next went to rest: it waits for no message.
    assert 1998 - missed <= held.sum() <= 2002
    assert np.all(np.diff(rows["current_setpoint"][np.argmax(held) :]) <= 0.0)
    assert rows["current_setpoint"][-1] == 0.0
    assert recording.read("longitudinal_belt")["engaged_setpoint"][-1] == 1.0  # its rest


def test_setpoint_with_two_values_moves_nothing(tmp_path: Path) -> None:
    two = ["wheel_servo.current=0.1A", "wheel_servo.current=0.2A"]
    done = rigd("jog", *two, "--rig", "lugre-1", cwd=tmp_path)
    assert done.code == 2
    assert "wheel_servo.current is given two values" in done.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("setpoint", "duration", "words"),
    [
        ("wheel_servo.current=5A", "1 s", "above the rig's limit of 1.6 A"),
        ("wheel_servo.curent=1A", "1 s", "did you mean 'wheel_servo.current'?"),
        ("wheel_servo.current=1V", "1 s", "'1V' is in V, expected A"),
        ("wheel_servo.current=1A", "1 m", "'1 m' is in m, expected s"),
        ("wheel_servo.current", "1 s", "is not SETPOINT=VALUE"),
        ("current=1A", "1 s", "did you mean 'wheel_servo.current'?"),
        ("spindle.speed=1A", "1 s", "the rig lugre-1 has no setpoint 'spindle.speed'"),
        ('x": {}, "y=1A', "1 s", "has no setpoint 'x\": {}, \"y'"),
    ],
)
def test_a_wrong_jog_moves_nothing(
    tmp_path: Path, setpoint: str, duration: str, words: str
) -> None:
    done = rigd("jog", setpoint, "--for", duration, "--rig", "lugre-1", cwd=tmp_path)
    assert done.code == 2
    assert words in done.err
    assert "jog:" not in done.err  # no place in a text that the person never saw
    assert not list(tmp_path.iterdir())


def test_rig_in_use_is_refused_with_its_holder(tmp_path: Path) -> None:
    first = start(
        ["jog", "wheel_servo.current=0.1A", "--for", "60 s", "--rig", "lugre-1"], cwd=tmp_path
    )
    try:
        first.wait_for("recording to")
        second = rigd("jog", "wheel_servo.current=0.1A", "--rig", "lugre-1", cwd=tmp_path)
        assert second.code == 3
        assert f"in use by process {first.process.pid}" in second.err
        assert "rigd run jog" in second.err
    finally:
        first.process.send_signal(2)
        ended = first.end()
    assert ended.code == 5
    assert "stopped" in ended.out
