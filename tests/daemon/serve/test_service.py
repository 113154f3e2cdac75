"""What clients ask, command and stop, done: one axis, with the processes of real runs."""

from __future__ import annotations

import resource
import shutil
import time
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import ValidationError
from support.daemon import file_axis
from support.daemon.file_axis import word
from support.daemon.served_axis import ASKING, LONG, SWEEP, ServedAxis, travelling

from rigd.config.calibration.calibration import CalibrationSetup, load_calibration
from rigd.engine.shared import RunFolder
from rigd.model.errors import Blocked, Exit, RigdError
from rigd.model.limits import Interlock
from rigd.model.severity import Severity
from rigd.record import Recording
from rigd.remote.protocol import ClientUser, Code, Refusal
from rigd.remote.protocol.arguments import StartArguments
from rigd.sdk.shipped_files import shipped_folder


def children() -> list[int]:
    """Return the processes that this one has started, whichever thread did."""
    tasks = Path("/proc/self/task").glob("*/children")
    return [int(child) for task in tasks for child in task.read_text().split()]


def trials_of(path: Path) -> list[int]:
    """Return the numbers of the complete trials of a recording."""
    return sorted(t.number for t in Recording.open(path).info.trials if t.complete)


def test_a_run_is_started_shown_recorded_and_audited(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        assert served.status.state == "idle"
        run = served.start(set={"time": "0.4 s"}, note="wheel cleaned", specimen="W7")
        under_way = served.until(lambda status: status.step == "go")
        assert under_way.trial is not None
        assert (under_way.procedure, under_way.run, under_way.trials_total) == ("sweep", run, 3)
        assert under_way.trial.parameters["speed"] == pytest.approx(0.1)
        assert under_way.trial.units["speed"] == "m/s"
        later = served.until(lambda status: status.trials_done == 1 and status.trial)
        assert later.left_s is not None
        assert 0.2 < later.left_s < 1.6
        (line,) = served.ask("runs")["runs"]
        assert (line["run"], line["state"]) == (run, "running")
        with pytest.raises(Refusal, match="is being recorded"):
            served.ask("fetch", run=run)
        last = served.until_idle().last
        assert last is not None
        assert (last.run, last.ending, last.exit_code) == (run, "complete", 0)
        assert "trial_start" in {event.kind for event in served.outlet.events}
        assert served.outlet.frames > 10
        assert "axis.position" in served.ask("latest")["values"]
    info = Recording.open(tmp_path / "runs" / run).info
    assert (info.state, info.trials_done) == ("complete", 3)
    assert info.metadata["run"]["operator"] == "alice"
    assert info.metadata["run"]["note"] == "wheel cleaned"
    assert info.specimen == {"name": "W7"}
    assert word(served.axis) == "safe"
    what = [(line["who"], line["what"], line["result"]) for line in served.audited()]
    assert what == [("alice", "lease_take", "done"), ("alice", "start", "done")]
    assert "text" not in served.audited()[1]["args"]["procedure"]


def test_start_takes_the_calibration_of_now(tmp_path: Path) -> None:
    file = tmp_path / "calibration.yaml"
    text = (shipped_folder("configs") / "calibrations" / "approach_angle.yaml").read_text()
    file.write_text(text)
    setup = CalibrationSetup(file, load_calibration(file))
    rig = replace(file_axis.rig(tmp_path / "axis"), calibration=setup)
    with ServedAxis(tmp_path, rig) as served:
        file.write_text(renewed := f"# renewed\n{text}")
        run = served.start(set={"time": "0.1 s"})
        served.until_idle()
        attached = Recording.open(tmp_path / "runs" / run).attachments
        assert attached["calibration.yaml"].data.decode() == renewed
        file.write_text(text.replace("values:", "valeus:"))
        with pytest.raises(RigdError, match="valeus"):
            served.start()


def test_control_characters_in_a_note_are_refused(tmp_path: Path) -> None:
    for said in ({"note": "a\x1b[2Jb"}, {"meta": {"specimen": "a\nb"}}):
        with pytest.raises(ValidationError, match="control character"):
            StartArguments.model_validate({"procedure": travelling(LONG), **said})


def test_a_start_without_demanded_fields_is_refused(tmp_path: Path) -> None:
    lab = tmp_path / "lab.yaml"
    lab.write_text("lab: mine\nfields: {meta.batch: {required: true, doc: Of the supplier}}\n")
    rig = replace(file_axis.rig(tmp_path / "axis"), lab=lab)
    with ServedAxis(tmp_path, rig) as served:
        (stated,) = served.ask("describe")["stated"]
        assert (stated["name"], stated["required"]) == ("meta.batch", True)
        with pytest.raises(RigdError, match=r"the lab mine demands meta\.batch of each run"):
            served.start(meta={"lot": "7"})
        assert served.status.run is None
        lab.write_text("lab: mine\nfields: {batch: {}}\n")
        assert served.ask("describe")["stated"] == []
        with pytest.raises(RigdError, match=r"lab\.yaml:2"):
            served.command("start", procedure=travelling(LONG))
    assert list((tmp_path / "runs").glob("*.mcap")) == []


def test_person_behind_a_shared_client_is_recorded(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.command("lease_take", "panel", user="Ada")
        run = served.command("start", "panel", user="Ada", procedure=travelling(LONG))["run"]
        assert served.status.lease.holder == ClientUser.of("panel", "Ada")
        served.until(lambda status: status.step == "go")
        served.stop("panel", "abort", "smoke\x1b[2J\n", "Olga")
        last = served.until_idle().last
        assert last is not None
        assert last.reason == "abort by Olga (panel): smoke [2J "
    assert [(line["who"], line["user"], line["what"]) for line in served.audited()] == [
        ("panel", "Ada", "lease_take"), ("panel", "Ada", "start"), ("panel", "Olga", "abort"),
    ]  # fmt: skip
    began = Recording.open(served.runs / run).info.metadata["run"]
    assert began["operator"] == "Ada (panel)"


def test_second_start_is_refused_during_a_run(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(LONG)
        with pytest.raises(Refusal, match="sweep is running") as refused:
            served.start(SWEEP)
        assert refused.value.code is Code.CONFLICT
        served.stop("eve", "abort")
        served.until_idle()
    assert len(list(served.runs.glob("*.mcap"))) == 1


def test_rig_of_a_daemon_is_in_use(tmp_path: Path) -> None:
    with (
        ServedAxis(tmp_path) as served,
        pytest.raises(Blocked, match=r"rigd serve.*\n  .*rigd remote start PROCEDURE --rig file-"),
    ):
        RunFolder.take(served.rig.name, command="rigd run")


@pytest.mark.parametrize(
    ("verb", "ending"), [("stop", "stopped"), ("abort", "aborted"), ("estop", "estopped")]
)
def test_every_client_may_stop(tmp_path: Path, verb: str, ending: str) -> None:
    with ServedAxis(tmp_path) as served:
        assert served.stop("eve", verb) is False
        served.start(LONG)
        served.until(lambda status: status.step == "go")
        assert served.stop("eve", verb, "smoke") is True
        assert served.stop("eve", verb, "smoke") is False
        last = served.until_idle().last
        assert last is not None
        assert (last.ending, last.reason, last.exit_code) == (ending, f"{verb} by eve: smoke", 5)
    assert word(served.axis) == "safe"
    assert [line["what"] for line in served.audited()] == ["lease_take", "start", verb]


def test_estop_does_not_wait_for_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def hang(*_: object) -> None:
        raise AssertionError("a stop was written down before it was answered")

    with ServedAxis(tmp_path) as served:
        served.start(LONG)
        with monkeypatch.context() as broken:
            broken.setattr(served.audit, "write", hang)
            assert served.stop("eve", "stop")
            assert served.stop("eve", "estop")
        served.until_idle()
    assert [line["what"] for line in served.audited()[2:]] == ["stop", "estop"]


@pytest.mark.parametrize("step_s", [-30, 30])
def test_step_of_clock_leaves_ages_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step_s: int
) -> None:
    with ServedAxis(tmp_path) as served:
        real = time.time_ns
        monkeypatch.setattr(time, "time_ns", lambda: real() + step_s * 1_000_000_000)
        before, now, after = served.ask("latest"), served.status, served.ask("latest")
    assert before["t_ns"] <= now.rows_ns <= after["t_ns"]


def test_lease_is_renewed_while_the_disk_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hang(*_: object, **__: object) -> None:
        raise AssertionError("a lease command waited for the audit log")

    with ServedAxis(tmp_path) as served:
        served.start(LONG)
        with monkeypatch.context() as broken:
            broken.setattr(served.audit, "write", hang)
            with pytest.raises(Refusal, match="alice has the control lease"):
                served.command("lease_take", "bob")
            served.command("lease_request", "bob")
            served.command("lease_renew", "alice")
        served.service.tend()
    assert [(line["who"], line["what"]) for line in served.audited()[2:]] == [
        ("bob", "lease_take"), ("bob", "lease_request"),
    ]  # fmt: skip


def test_run_of_lost_client_ends_before_logging(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(LONG)
        served.stop("eve", "stop")
        served.clock.ahead_ns += 10**11
        handled: list[bool] = []

        def note(*_: object, **__: object) -> None:
            handled.append(
                any("gave no sign of life" in item.text for item in served.status.notices)
            )

        monkeypatch.setattr(served.audit, "write", note)
        served.service.tend()
    assert handled == [True, True]


def test_stop_while_devices_open_ends_the_run(tmp_path: Path) -> None:
    with ServedAxis(tmp_path, opens_in_s=20.0) as served:
        served.start()
        served.until(lambda status: served.axis.exists())
        served.stop("eve", "stop")
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "stopped"


def test_a_run_is_paused_and_resumed(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        with pytest.raises(Refusal, match="nothing is running"):
            served.command("lease_take")
            served.command("pause")
        served.start()
        served.command("pause")
        paused = served.until(lambda status: status.state == "paused")
        assert paused.trial is None
        served.command("resume")
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


def test_any_holder_of_lease_resumes_held_step(tmp_path: Path) -> None:
    text = LONG.replace("default: 30 s", "default: 0.5 s").replace("1 m/s, 0.2 m/s, 0.3", "1")
    with ServedAxis(tmp_path) as served:
        served.command("lease_take")
        served.start(text.replace("for: ${time}", "for: ${time}\n      hold: {timeout: 60 s}"))
        served.until(lambda status: status.can_hold)
        served.command("pause")
        served.until(lambda status: status.state == "held")
        served.command("lease_release")
        served.command("lease_take", "eve")
        served.command("resume", "eve")
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


def test_only_lease_holder_answers_prompts(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        run = served.start(ASKING)
        first = served.until(lambda status: status.prompt).prompt
        assert first is not None
        assert (first.name, first.unit, first.low, first.high, first.answer) == (
            "put_load", "kg", 0.0, 5.0, 1.0,
        )  # fmt: skip
        with pytest.raises(Refusal, match=r"7 kg is outside 0 kg \.\. 5 kg"):
            served.command("answer", prompt_id=first.id, value=7.0)
        with pytest.raises(Refusal, match="expects a number in kg"):
            served.command("answer", prompt_id=first.id, value="heavy")
        served.command("answer", prompt_id=first.id, value=1.1)
        second = served.until(lambda status: status.prompt and status.trials_done == 1).prompt
        assert second is not None
        assert second.id != first.id
        with pytest.raises(Refusal, match=r"no prompt .* waits") as refused:
            served.command("answer", prompt_id=first.id, value=1.0)
        assert refused.value.code is Code.CONFLICT
        served.command("answer", prompt_id=second.id, value=2.0)
        served.until_idle()
    given = [e.data for e in Recording.open(served.runs / run).events() if e.kind == "answer"]
    assert [(item["answer"], item["by"]) for item in given] == [(1.1, "alice"), (2.0, "alice")]


def test_stop_ends_a_waiting_prompt(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(ASKING)
        served.until(lambda status: status.prompt)
        served.stop("eve", "stop")
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "stopped"
        assert served.status.prompt is None


def test_answers_of_procedure_are_used_on_request(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(ASKING, answers="procedure")
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


FAR = Interlock("far", "axis.position", high=0.005, action=Severity.ABORT, message="too far out")


def test_after_trip_nothing_starts_before_it_is_acknowledged(tmp_path: Path) -> None:
    with ServedAxis(tmp_path, interlocks=(FAR,)) as served:
        served.start(LONG)
        status = served.until_idle()
        (trip,) = status.trips
        assert status.last is not None
        assert (status.last.ending, status.last.exit_code) == ("aborted", 4)
        assert (trip.interlock, trip.action, trip.latched, trip.acknowledged) == (
            "far", "abort", True, False,
        )  # fmt: skip
        assert "above its limit" in trip.message
        assert "too far out" in trip.message
        with pytest.raises(Refusal, match=r"far tripped: axis\.position") as refused:
            served.start(SWEEP)
        assert refused.value.code is Code.REFUSED
    # Nor does it after the daemon was started again.
    with ServedAxis(tmp_path, interlocks=(FAR,)) as served:
        with pytest.raises(Refusal, match="far tripped"):
            served.start(SWEEP)
        since_ns = served.status.trips[0].since_ns
        with pytest.raises(Refusal, match="tripped again since"):
            served.command("acknowledge", interlock="far", since_ns=since_ns - 1_000_000)
        served.command("acknowledge", interlock="far", since_ns=since_ns)
        assert served.status.trips[0].acknowledged
        with pytest.raises(Refusal, match="nothing to acknowledge"):
            served.command("acknowledge", interlock="far")
        served.start(SWEEP.replace("m/s, 0.2 m/s, 0.3 m/s]", "m/s]"))  # not as far
        status = served.until_idle()
        assert status.last is not None
        assert status.last.ending == "complete"
        assert status.trips == ()


def test_blocked_run_reports_the_reason(tmp_path: Path) -> None:
    near = Interlock("near", "axis.position", low=0.05, action=Severity.ABORT)
    with ServedAxis(tmp_path, interlocks=(near,)) as served:
        served.start()
        last = served.until_idle().last
        assert last is not None
        assert (last.ending, last.exit_code, last.recorded) == ("blocked", 3, False)
        assert "near is violated at rest" in last.reason
        assert not list(served.runs.glob("*.mcap"))


def test_mistake_in_procedure_is_reported_with_its_place(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.command("lease_take")
        misspelt = SWEEP.replace("axis.speed", "axis.speeed")
        with pytest.raises(
            Refusal, match=r"sweep.yaml:11:13: .*speeed'\n  did you mean"
        ) as refused:
            served.command("start", procedure=travelling(misspelt))
        assert refused.value.code is Code.WRONG
        assert refused.value.exit_code == Exit.BAD_INPUT  # as of `rigd check`
        assert served.status.state == "idle"


def test_no_run_starts_without_the_audit_log(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.command("lease_take")
        served.audit.path = tmp_path / "no such folder" / "audit.jsonl"
        with pytest.raises(Refusal, match="this command could not be logged"):
            served.command("start", procedure=travelling(SWEEP))
        assert served.status.state == "idle"
        assert served.stop("eve", "stop") is False
        for _ in range(2):
            served.service.tend()
        told = [notice.text for notice in served.status.notices if notice.level == "error"]
        assert len(told) == 1
        assert told[0].startswith("nothing can start: ")
        assert told[0].endswith("audit.jsonl cannot be written: No such file or directory")
        assert str(tmp_path) not in told[0]  # observers see it


def test_interrupted_run_is_offered_and_resumed(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        run = served.start(set={"time": "0.5 s"}, answers="procedure")
        served.until(lambda status: status.trials_done == 1 and status.step == "go")
        served.stop("eve", "abort")
        served.until_idle()
        assert served.status.interrupted == ()  # a person wanted its end
        served.command("resume_run", run=run)
        status = served.until_idle()
        assert status.last is not None
        assert (status.last.run, status.last.ending) == (run, "complete")
        with pytest.raises(Refusal, match="no trial is missing"):
            served.command("resume_run", run=run)
        with pytest.raises(Refusal, match="there is no recording"):
            served.command("resume_run", run="other.mcap")
    assert trials_of(served.runs / run) == [1, 2, 3]


def test_run_that_filled_disk_is_resumed(tmp_path: Path) -> None:
    """Its last samples wait in memory, in the folder that the daemon holds, until there is room."""
    with ServedAxis(tmp_path) as served:
        run = served.start(set={"time": "0.5 s"}, answers="procedure")
        served.until(lambda status: status.trials_done == 1 and status.step == "go")
        for child in children():
            resource.prlimit(child, resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
        last = served.until_idle().last
        assert last is not None
        assert (last.run, last.ending) == (run, "faulted")
        served.command("resume_run", run=run)
        last = served.until_idle().last
        assert last is not None
        assert (last.run, last.ending) == (run, "complete")
    assert trials_of(served.runs / run) == [1, 2, 3]


def test_daemon_that_ends_stops_run_and_begins_nothing(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        run = served.start(LONG)
        served.until(lambda status: status.step == "go")
        assert served.steering.leave("stopped by SIGTERM") is not None
        served.steering.close()
        with pytest.raises(Refusal, match="the daemon is ending: stopped by SIGTERM"):
            served.start(SWEEP)
    assert Recording.open(served.runs / run).info.reason == "stopped by SIGTERM"


def test_description_has_the_constant_data(tmp_path: Path) -> None:
    with ServedAxis(tmp_path, interlocks=(FAR,)) as served:
        told = served.ask("describe")
    assert told["rig"] == served.rig.name
    assert [item["name"] for item in told["streams"]] == ["axis", "cycle"]
    assert told["streams"][0]["rate_hz"] == pytest.approx(50.0)
    (setpoint,) = told["setpoints"]
    assert (setpoint["name"], setpoint["low"], setpoint["high"]) == ("axis.speed", -1.5, 1.5)
    (interlock,) = told["interlocks"]
    assert (interlock["name"], interlock["low"], interlock["high"]) == ("far", None, 0.005)
    assert not told["simulated"]


def test_status_is_always_available(tmp_path: Path) -> None:
    """With any content, it is a message that a client can read."""
    with ServedAxis(tmp_path) as served:
        served.notices.note("x" * 100_000, "error")
        assert len(served.status.notices[-1].text) == 1000
        assert served.status.seq < served.status.seq


def sweep_of(steps: int, trials: int) -> str:
    """A procedure of so many steps in each of so many trials."""
    step = "    - {step: s%d, set: {axis.speed: '${speed}'}, for: 0.1 s}\n"
    return (
        "procedure: long\ntitle: Long\ndoc: For tests.\n"
        "parameters: {speed: {doc: Speed, unit: m/s}}\n"
        f"sweep: {{grid: {{speed: {{from: 0 m/s, to: {(trials - 1) * 1e-5:.5f} m/s, "
        "step: 0.00001 m/s}}}\ntrial:\n  steps:\n" + "".join(step % n for n in range(steps))
    )


def test_check_of_too_many_steps_is_refused_immediately(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        found = served.ask("check", procedure=travelling(sweep_of(500, 16_000)), set={})
    told = "16000 trials of 2000 steps and values are 32000000, more than 400000"
    assert [item["message"] for item in found["problems"]] == [told]
    assert found["problems"][0]["line"] == 7


def test_folder_removed_during_run_spoils_no_later_run(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(set={"time": "2 s"})
        served.until(lambda status: status.step == "go")
        shutil.rmtree(served.runs)
        ended = served.until_idle().last
        assert ended is not None
        again = served.start(set={"time": "0.1 s"})
        last = served.until(lambda status: status.last and status.last.run == again).last
        assert last is not None
        assert (last.ending, last.exit_code) == ("complete", 0), (last, ended)
        assert Recording.open(served.runs / again).info.state == "complete"
