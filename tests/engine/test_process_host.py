"""The cycle in a process of its own: its programs, and a safe rig after any death."""

from __future__ import annotations

import math
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.daemon import file_axis
from support.daemon.file_axis import word
from support.faults.stalls import witnessed
from support.instruments.name_server import lose_name_server
from support.wire import ROOT

from rigd.config.loader import load_rig
from rigd.config.rig import RestBound, RigConfig, Waiver
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.play.control import Control
from rigd.engine.play.player import Outcome
from rigd.engine.process import process_host
from rigd.engine.process.launch import launch
from rigd.engine.process.process_host import ProcessHost
from rigd.engine.shared import Job, RunFolder, Word
from rigd.model.errors import Blocked, RecordingError
from rigd.model.limits import Interlock
from rigd.model.severity import Severity
from rigd.procedure.profiles.profiles import ConstantProfile
from rigd.procedure.program import CycleProgram, Hold, Recorded, Segment, TrialLimit

pytestmark = pytest.mark.usefixtures("own_state")


@contextmanager
def host_of(
    rig: RigConfig, capacity: int = 20_000
) -> Iterator[tuple[ProcessHost, RunFolder, Control]]:
    streams = tuple(streams_of(rig))
    folder = RunFolder.take(rig.name, command="test")
    job = Job(rig.name, folder.path / "x.mcap", streams, time.time_ns())
    folder.prepare(job, {stream.name: capacity for stream in streams})
    control = Control()
    record = {stream.name: Recorded() for stream in streams}
    host = launch(rig, folder, job, control, record=record, finish=lambda: None)
    try:
        yield host, folder, control
    finally:
        host.make_safe()
        host.close()
        folder.clear()
        folder.release()


def move(speed: float, duration_s: float = 0.1) -> CycleProgram:
    return CycleProgram(
        (Segment("go", {"axis.speed": ConstantProfile(speed)}, duration_s=duration_s),)
    )


def ready(host: ProcessHost) -> None:
    assert host.open() == ()
    assert host.settle(20) is None
    assert host.arming_blockers() == ()
    assert host.arm() is None


def kinds(folder: RunFolder) -> list[str]:
    return [event.kind for event in folder.event_ring("cycle").peek()]


def while_moving(host: ProcessHost, path: Path, act: Callable[[], object]) -> Outcome:
    """Play a long movement and ``act`` once the axis moves."""
    acted = False

    def look() -> None:
        nonlocal acted
        if not acted and word(path) == "moving":
            acted = True
            act()

    host.on_drain = look
    outcome = host.play(move(0.5, 20.0))
    assert acted
    return outcome


def test_a_program_is_played_and_every_cycle_recorded(tmp_path: Path) -> None:
    with host_of(file_axis.rig(tmp_path / "axis")) as (host, folder, _):
        ready(host)
        assert host.play(move(0.5)).severity is Severity.DONE
        assert host.play(move(-0.5)).severity is Severity.DONE
        assert host.lockout_reason() == ""
        assert host.make_safe() == ()
        assert word(tmp_path / "axis") == "safe"
        rings = folder.row_rings(folder.job)
        rows, cycles = rings["axis"].peek(), rings["cycle"].peek()
        assert len(rows) == len(cycles) == host.counters.cycles
        slots = cycles["scheduled"] / 0.002
        skipped = round(slots[-1] - slots[0]) + 1 - len(slots)
        assert skipped == host.counters.missed
        assert (cycles["actual"] >= cycles["scheduled"]).all()
        assert set(rows["speed_setpoint"]) >= {0.0, 0.5, -0.5}
        assert kinds(folder)[:3] == ["devices", "watchdog", "realtime"]


def test_step_is_held_and_goes_on(tmp_path: Path) -> None:
    go = replace(move(0.5, 0.2).segments[0], hold=Hold({"axis.speed": 0.0}, 20.0))
    with host_of(file_axis.rig(tmp_path / "axis")) as (host, folder, control):
        ready(host)
        seen: list[bool] = []

        def person() -> None:
            seen.append(host.held)
            control.pause_wanted = seen.count(True) < 3

        host.on_drain = person
        assert host.play(CycleProgram((go,))).severity is Severity.DONE
        assert not host.held
        host.make_safe()
        events = [item for item in folder.event_ring("cycle").peek() if item.kind == "hold"]
        assert [item.data["phase"] for item in events] == ["held", "returning", "over"]
        held_ns, back_ns = events[0].t_ns, events[1].t_ns
        rows = folder.row_rings(folder.job)["axis"].peek()
        speeds = rows["speed_setpoint"][(rows["t_ns"] > held_ns) & (rows["t_ns"] < back_ns)]
        assert speeds[-1] == 0.0


def test_axis_is_safe_if_cycle_dies_while_held(tmp_path: Path) -> None:
    go = replace(move(0.5, 20.0).segments[0], hold=Hold({"axis.speed": 0.4}, 20.0))
    path = tmp_path / "axis"
    with host_of(file_axis.rig(path)) as (host, folder, control):
        ready(host)
        control.pause_wanted = True

        def kill() -> None:
            if host.held and word(path) == "moving":
                os.kill(folder.board()[Word.PID_CYCLE], signal.SIGKILL)

        host.on_drain = kill
        assert host.play(CycleProgram((go,))).severity is Severity.FAULT
        assert word(path) == "rescued"


def test_setpoints_are_held_between_two_programs(tmp_path: Path) -> None:
    with host_of(file_axis.rig(tmp_path / "axis")) as (host, folder, _):
        ready(host)
        for _ in range(5):
            assert host.play(move(0.5, 0.05)).severity is Severity.DONE
        host.make_safe()
        speeds = folder.row_rings(folder.job)["axis"].peek()["speed_setpoint"]
        moving = speeds.nonzero()[0]
        assert (speeds[moving[0] + 3 : moving[-1]] == 0.5).all()


def test_next_program_begins_in_next_cycle_without_daemon(tmp_path: Path) -> None:
    """Braking must not wait for a daemon that the machine starves."""
    with host_of(file_axis.rig(tmp_path / "axis")) as (host, folder, _):
        ready(host)
        brake = move(-0.5, 0.6)
        assert host.play(move(1.0, 0.2), brake).severity is Severity.DONE
        time.sleep(0.3)  # the daemon is away
        assert host.play(brake).severity is Severity.DONE
        # If it is over before the first request, that is what is reported.
        short = move(-1.0, 0.05)
        assert host.play(move(1.0, 0.2), short).severity is Severity.DONE
        time.sleep(0.3)
        assert host.play(short).severity is Severity.DONE
        host.make_safe()
        rows = folder.row_rings(folder.job)["axis"].peek()
        speeds = rows["speed_setpoint"]
        # 0.2 s of 2 ms each, less the ramp of 5 cycles: not one cycle longer. By the times of the
        # rows, as a busy machine misses cycles.
        at_speed = np.flatnonzero(speeds == 1.0)
        twice = np.split(at_speed, np.flatnonzero(np.diff(at_speed) > 1) + 1)
        assert len(twice) == 2
        for stretch in twice:
            assert 20 < len(stretch) <= 97
            assert rows["t_ns"][stretch[-1]] - rows["t_ns"][stretch[0]] <= 96 * 2_000_000
        assert {-0.5, -1.0} <= set(speeds)


def test_next_program_is_skipped_after_early_end(tmp_path: Path) -> None:
    with host_of(file_axis.rig(tmp_path / "axis")) as (host, folder, _):
        ready(host)
        limit = TrialLimit("axis.position", -1.0, 0.05)
        program = CycleProgram(move(0.5, 20.0).segments, (limit,))
        after = move(-0.25, 0.1)
        assert host.play(program, after).severity is Severity.END_TRIAL
        host.rest_while(lambda: False)
        speeds = folder.row_rings(folder.job)["axis"].peek()["speed_setpoint"]
        assert -0.25 not in speeds
        assert host.play(after).severity is Severity.DONE
        speeds = folder.row_rings(folder.job)["axis"].peek()["speed_setpoint"]
        assert -0.25 in speeds


def test_stop_request_ends_the_program(tmp_path: Path) -> None:
    with host_of(file_axis.rig(tmp_path / "axis")) as (host, _, control):
        ready(host)
        path = tmp_path / "axis"
        outcome = while_moving(host, path, lambda: control.request(Severity.STOP, "enough"))
        assert (outcome.severity, outcome.reason) == (Severity.STOP, "enough")
        assert word(path) == "still"


def pass_on(host: ProcessHost, folder: RunFolder) -> None:
    """Let the cycle act on requests while no caller waits for an outcome."""
    board = folder.board()
    enough, deadline = board[Word.CYCLES] + 10, time.monotonic() + 20
    while board[Word.CYCLES] < enough and time.monotonic() < deadline:
        host.arming_blockers()


def test_stop_after_a_rest_prevents_the_next_program(
    tmp_path: Path,
) -> None:
    with host_of(file_axis.rig(tmp_path / "axis")) as (host, folder, control):
        ready(host)
        assert host.rest_while(lambda: False) is None
        control.request(Severity.STOP, "enough")
        pass_on(host, folder)
        outcome = host.play(move(0.5))
        assert (outcome.severity, outcome.reason) == (Severity.STOP, "enough")
        assert host.play(move(0.5)).severity is Severity.DONE  # such as `finish`: once is enough
        speeds = folder.row_rings(folder.job)["axis"].peek()["speed_setpoint"]
        assert (speeds != 0).sum() < 120  # of one program: 50 cycles, and the hold after it


def test_stop_is_not_forgotten_for_trip_that_follows(tmp_path: Path) -> None:
    path = tmp_path / "axis"
    low = Interlock("low", "axis.position", low=-0.01, action=Severity.END_TRIAL, message="low")
    rig = file_axis.rig(path, interlocks=(low,), drops_after_s=2.0)
    with host_of(rig) as (host, _, control):
        ready(host)
        assert host.play(move(0.5)).severity is Severity.DONE
        control.request(Severity.STOP, "enough")
        deadline = time.monotonic() + 20
        while not host.lockout_reason() and time.monotonic() < deadline:
            pass
        assert "low" in host.lockout_reason()
        assert host.play(move(0.5)).severity is Severity.STOP


def test_nothing_is_armed_after_the_cycle_has_acted(tmp_path: Path) -> None:
    path = tmp_path / "axis"
    with host_of(file_axis.rig(path)) as (host, folder, control):
        assert host.open() == ()
        assert host.settle(20) is None
        control.request(Severity.ABORT, "enough")
        pass_on(host, folder)
        outcome = host.arm()
        assert outcome is not None
        assert outcome.severity is Severity.ABORT
        pass_on(host, folder)
        assert word(path) == "opened"  # an armed axis would have been written to


def once_open(path: Path, control: Control) -> None:
    """Ask for a stop as soon as the axis is being opened."""
    deadline = time.monotonic() + 30
    while not path.exists() and time.monotonic() < deadline:
        time.sleep(0.01)
    control.request(Severity.STOP, "stopped by SIGINT")


def test_stop_request_acts_while_devices_open(tmp_path: Path) -> None:
    path = tmp_path / "axis"
    with host_of(file_axis.rig(path, opens_in_s=60.0)) as (host, _, control):
        stopping = threading.Thread(target=once_open, args=(path, control))
        stopping.start()
        with witnessed() as lost_s:
            began = time.monotonic()
            (reason,) = host.open()
            assert time.monotonic() - began < 20 + lost_s()
        stopping.join()
        assert reason.startswith("stopped by SIGINT, while devices were opened")
        assert word(path) == "rescued"


def test_device_of_another_holder_is_not_commanded(tmp_path: Path) -> None:
    """A run that dies while it waits for a link must not stop the drives of its holder."""
    path = tmp_path / "axis"
    with host_of(file_axis.rig(path, link_held=True)) as (host, _, control):
        threading.Timer(1.5, control.request, (Severity.STOP, "stopped by SIGINT")).start()
        (reason,) = host.open()
        assert reason == "stopped by SIGINT, while devices were opened"
    assert not path.exists()


def test_simulated_rig_is_recorded_after_made_safe(tmp_path: Path) -> None:
    with host_of(load_rig(ROOT / "configs" / "sim_lugre.yaml")) as (host, folder, _):
        ready(host)
        assert host.make_safe() == ()
        safe_ns = host.t_ns
        host.read_on(1.0, asking=True)
        rows = folder.row_rings(folder.job)["wheel_servo"].drain()
    after = rows[rows["t_ns"] > safe_ns]
    assert len(after) > 10
    assert after["t_ns"][-1] > safe_ns + 200_000_000
    assert not after["current_setpoint"].any()


def rig_with_rest() -> RigConfig:
    """Return a simulated rig that rests once its carriage moves by less than 10 mm/s."""
    rig = load_rig(ROOT / "configs" / "sim_lugre.yaml")
    bound = RestBound("carriage.position", 0.01, "m/s", is_rate=True)
    return replace(rig, supervision=replace(rig.supervision, at_rest=(bound,)))


def test_rows_end_once_the_rig_rests() -> None:
    with host_of(rig_with_rest()) as (host, _, _):
        ready(host)
        assert host.make_safe() == ()
        safe_ns = host.t_ns
        assert host.read_on(60.0, asking=True) == {}
        assert host.t_ns - safe_ns < 30_000_000_000


def test_cycle_killed_before_rest_leaves_rest_unknown() -> None:
    with host_of(rig_with_rest()) as (host, folder, _):
        ready(host)
        assert host.make_safe() == ()

        def kill() -> None:
            host.on_drain = lambda: None
            os.kill(folder.board()[Word.PID_CYCLE], signal.SIGKILL)

        host.on_drain = kill
        (value,) = host.read_on(60.0, asking=True).values()
        assert math.isnan(value)


def test_a_trip_reaches_the_run_with_its_reason(tmp_path: Path) -> None:
    far = Interlock("far", "axis.position", high=0.05, action=Severity.ABORT, message="too far")
    with host_of(file_axis.rig(tmp_path / "axis", interlocks=(far,))) as (host, _, _):
        ready(host)
        outcome = host.play(move(0.5, 20.0))
        assert outcome.severity is Severity.ABORT
        assert "above its limit" in outcome.reason
        assert [trip.interlock.name for trip in host.trips] == ["far"]
        # What stands tripped is not played over.
        assert "far" in host.lockout_reason()


def test_acknowledged_interlock_trips_again_while_cause_remains(tmp_path: Path) -> None:
    far = Interlock("far", "axis.position", high=0.01, action=Severity.WARN, latch=True)
    with host_of(file_axis.rig(tmp_path / "axis", interlocks=(far,))) as (host, _, control):
        ready(host)
        assert host.play(move(0.5, 0.3)).severity is Severity.DONE
        assert len(host.trips) == 1
        control.acknowledged.append("far")
        assert host.play(move(0.5, 0.3)).severity is Severity.DONE
        assert [trip.interlock.name for trip in host.trips] == ["far", "far"]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_lost_or_hanging_cycle_leads_to_rescue(tmp_path: Path, number: signal.Signals) -> None:
    path = tmp_path / "axis"
    with host_of(file_axis.rig(path)) as (host, folder, _):
        ready(host)
        pid = folder.board()[Word.PID_CYCLE]
        outcome = while_moving(host, path, lambda: os.kill(pid, number))
        assert outcome.severity is Severity.FAULT
        killed = outcome.reason.startswith("the cycle process was ended by SIGKILL")
        assert killed is (number is signal.SIGKILL), outcome.reason
        assert "made safe over a second link" in outcome.reason
        assert word(path) == "rescued"
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
        assert host.play(move(0.5)).severity is Severity.FAULT
        assert word(path) == "rescued"


def test_rescue_looks_no_name_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "axis"
    with socket.create_server(("127.0.0.1", 0)) as server:
        rig = file_axis.rig(path, tcp_port=server.getsockname()[1])
        with host_of(rig) as (host, folder, _):
            ready(host)
            lose_name_server(monkeypatch)
            os.kill(folder.board()[Word.PID_CYCLE], signal.SIGKILL)
            assert "made safe over a second link" in host.play(move(0.5)).reason
            assert word(path) == "rescued"


def test_hanging_driver_ends_run_like_dead_cycle(tmp_path: Path) -> None:
    path = tmp_path / "axis"
    with host_of(file_axis.rig(path, hang_after_s=0.5)) as (host, _, _):
        ready(host)
        outcome = host.play(move(0.5, 20.0))
        assert outcome.severity is Severity.FAULT
        assert "no sign of life" in outcome.reason
        assert word(path) == "rescued"


def test_cycle_lost_in_preflight_blocks_by_its_reason(tmp_path: Path) -> None:
    with host_of(file_axis.rig(tmp_path / "axis")) as (host, folder, _):
        assert host.open() == ()
        assert set(host.identities()) == {"axis"}
        assert (host.active_interlocks(), host.loads(), host.lockout_reason()) == ((), {}, "")
        os.kill(folder.board()[Word.PID_CYCLE], signal.SIGKILL)
        assert host.identities() == {}  # an identity that is not reported is not invented
        assert (host.active_interlocks(), host.loads()) == ((), {})
        (arming_blockers,) = host.arming_blockers()
        assert "the cycle process was ended by SIGKILL" in arming_blockers
        assert host.lockout_reason() == arming_blockers


def test_cycle_slow_at_make_safe_is_not_killed(tmp_path: Path) -> None:
    path = tmp_path / "axis"
    slow = file_axis.rig(path, fails_after_s=1.0, safe_takes_s=0.6)
    assert slow.supervision.cycle_silence_s < 0.6
    with host_of(slow) as (host, _, _):
        ready(host)
        outcome = host.play(move(0.5, 20.0))
        assert (outcome.severity, outcome.reason) == (Severity.FAULT, "axis: the belt is torn")
        assert word(path) == "safe"


def test_unsafe_devices_are_made_safe_over_second_link(tmp_path: Path) -> None:
    path = tmp_path / "axis"
    with host_of(file_axis.rig(path, fails_after_s=1.0, safe_takes_s=60.0)) as (host, _, _):
        ready(host)
        outcome = host.play(move(0.5, 20.0))
        assert outcome.severity is Severity.FAULT
        assert "no sign of life" in outcome.reason
        assert word(path) == "rescued"


def test_cycle_that_answers_nothing_is_lost_not_bug(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "axis"
    for within_s in (1.5, 6.0, 24.0):
        monkeypatch.setattr(process_host, "OPEN_S", within_s)
        with host_of(file_axis.rig(path, opens_in_s=60.0)) as (host, _, _):
            (reason,) = host.open()
            assert reason.startswith(
                f"the cycle process gave no answer to Open within {within_s:g} s"
            )
        if path.exists():  # on a crowded machine it had not begun to open anything
            break
    assert word(path) == "rescued"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_to_the_cycle_process_aborts(tmp_path: Path, number: signal.Signals) -> None:
    path = tmp_path / "axis"
    with host_of(file_axis.rig(path)) as (host, folder, _):
        ready(host)
        pid = folder.board()[Word.PID_CYCLE]
        outcome = while_moving(host, path, lambda: os.kill(pid, number))
        assert outcome.severity is Severity.ABORT
        assert number.name in outcome.reason
        assert word(path) == "still"


def test_cycle_makes_safe_if_daemon_is_silent(tmp_path: Path) -> None:
    path = tmp_path / "axis"
    with host_of(file_axis.rig(path, daemon_silence_s=0.4)) as (host, folder, _):
        ready(host)

        def fall_silent() -> None:
            deadline = time.monotonic() + 20
            while word(path) != "safe" and time.monotonic() < deadline:
                time.sleep(0.01)

        outcome = while_moving(host, path, fall_silent)
        assert word(path) in ("safe", "rescued")
        assert outcome.severity is Severity.FAULT
        reasons = [str(event.data) for event in folder.event_ring("cycle").peek()]
        assert any("the daemon was silent for 0.4 s" in reason for reason in reasons)
        assert "the daemon was silent for 0.4 s" in outcome.reason


def test_without_watchdog_nothing_is_armed_but_by_waiver(tmp_path: Path) -> None:
    with host_of(file_axis.rig(tmp_path / "axis", watchdog=False)) as (host, _, _):
        (reason,) = host.open()
        assert "no watchdog" in reason
    waiver = Waiver("A. Person", "the motor is unplugged")
    with host_of(file_axis.rig(tmp_path / "axis", watchdog=False, waiver=waiver)) as (
        host,
        found,
        _,
    ):
        assert host.open() == ()
        (event,) = [item for item in found.event_ring("cycle").peek() if item.kind == "waiver"]
        assert event.data == {
            "device": "axis",
            "by": "A. Person",
            "reason": "the motor is unplugged",
        }


def test_watchdog_that_does_not_act_prevents_arming(tmp_path: Path) -> None:
    with host_of(file_axis.rig(tmp_path / "axis", proven=False)) as (host, _, _):
        (reason,) = host.open()
        assert reason.startswith("axis: its watchdog is not proven: it went on for 1 s")


def test_arming_waits_for_the_device_and_gives_up(tmp_path: Path) -> None:
    with host_of(file_axis.rig(tmp_path / "axis", ready_after_s=0.2)) as (host, _, _):
        ready(host)
    with host_of(file_axis.rig(tmp_path / "axis", ready_after_s=60.0)) as (host, _, _):
        host.open()
        outcome = host.arm()
        assert outcome is not None
        assert (outcome.severity, outcome.reason) == (
            Severity.FAULT,
            "axis did not become ready to run",
        )
        assert word(tmp_path / "axis") == "safe"


def test_ring_without_reader_ends_run(tmp_path: Path) -> None:
    path = tmp_path / "axis"
    with host_of(file_axis.rig(path), capacity=200) as (host, _, _):
        ready(host)
        with pytest.raises(RecordingError, match="is too slow"):
            host.play(move(0.5, 20.0))
        host.make_safe()
        assert word(path) == "safe"


def test_one_rig_is_driven_by_one(tmp_path: Path) -> None:
    rig = file_axis.rig(tmp_path / "axis")
    with host_of(rig), pytest.raises(Blocked, match=f"in use by process {os.getpid()}"):
        RunFolder.take(rig.name, command="another")


def test_cycle_tolerates_announced_wait_of_daemon(tmp_path: Path) -> None:
    """Longer than its silence would be taken for: the cycle hears of it meanwhile."""
    with host_of(file_axis.rig(tmp_path / "axis", daemon_silence_s=0.3)) as (host, _, _):
        ready(host)

        def slow() -> str:
            time.sleep(1.0)
            return "done"

        assert host.meanwhile(slow) == "done"
        with pytest.raises(ValueError, match="as it says"):
            host.meanwhile(lambda: int("as it says"))
        assert host.play(move(0.5)).severity is Severity.DONE
