"""What clients ask, command and stop, done: one axis, with the processes of real runs."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from pydantic import ValidationError
from support.file_axis import word
from support.served_axis import ASKING, SWEEP, ServedAxis, travelling

from rigd.engine.shared import RunFolder
from rigd.model.errors import Blocked, Exit
from rigd.model.limits import Interlock
from rigd.model.severity import Severity
from rigd.record import Recording, run_info
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.arguments import StartArguments
from rigd.remote.protocol.limits import LEASE_S

LONG = SWEEP.replace("default: 0.3 s", "default: 30 s")


def test_a_run_is_started_shown_recorded_and_audited(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        assert served.status.state == "idle"
        run = served.start(set={"time": "0.4 s"}, note="wheel cleaned", meta={"specimen": "W7"})
        under_way = served.until(lambda status: status.step == "go")
        assert under_way.trial is not None
        assert (under_way.procedure, under_way.run, under_way.trials_total) == ("sweep", run, 3)
        assert under_way.trial.parameters["speed"] == pytest.approx(0.1)
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
    info = run_info(Recording.open(tmp_path / "runs" / run))
    assert (info.state, info.trials_done) == ("complete", 3)
    assert info.metadata["run"]["operator"] == "alice"
    assert info.metadata["run"]["note"] == "wheel cleaned"
    assert info.metadata["meta"] == {"specimen": "W7"}
    assert word(served.axis) == "safe"
    what = [(line["who"], line["what"], line["result"]) for line in served.audited()]
    assert what == [("alice", "lease_take", "done"), ("alice", "start", "done")]
    assert "text" not in served.audited()[1]["args"]["procedure"]


def test_note_that_steers_a_terminal_starts_nothing(tmp_path: Path) -> None:
    for said in ({"note": "a\x1b[2Jb"}, {"meta": {"specimen": "a\nb"}}):
        with pytest.raises(ValidationError, match="which is no text"):
            StartArguments.model_validate({"procedure": travelling(LONG), **said})


def test_who_stands_behind_a_client_of_several_is_written_down(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.command("lease_take", "panel", user="Ada")
        run = served.command("start", "panel", user="Ada", procedure=travelling(LONG))["run"]
        assert served.status.lease.holder == "panel"
        served.until(lambda status: status.step == "go")
        served.service.stop("panel", "abort", "smoke\x1b[2J\n", "Olga")
        last = served.until_idle().last
        assert last is not None
        assert last.reason == "abort by Olga (panel): smoke [2J "
    assert [(line["who"], line["user"], line["what"]) for line in served.audited()] == [
        ("panel", "Ada", "lease_take"), ("panel", "Ada", "start"), ("panel", "Olga", "abort"),
    ]  # fmt: skip
    began = run_info(Recording.open(served.runs / run)).metadata["run"]
    assert began["operator"] == "Ada (panel)"


def test_two_starts_are_one_run(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(LONG)
        with pytest.raises(Refusal, match="sweep is running") as refused:
            served.start(SWEEP)
        assert refused.value.code is Code.CONFLICT
        served.service.stop("eve", "abort", "")
        served.until_idle()
    assert len(list(served.runs.glob("*.mcap"))) == 1


def test_the_rig_of_a_daemon_is_nobody_elses(tmp_path: Path) -> None:
    with (
        ServedAxis(tmp_path) as served,
        pytest.raises(Blocked, match=r"rigd serve.*\n  .*rigd remote start PROCEDURE --rig file-"),
    ):
        RunFolder.take(served.rig.name, command="rigd run")


@pytest.mark.parametrize(
    ("verb", "ending"), [("stop", "stopped"), ("abort", "aborted"), ("estop", "estopped")]
)
def test_whoever_may_connect_may_stop(tmp_path: Path, verb: str, ending: str) -> None:
    with ServedAxis(tmp_path) as served:
        assert served.service.stop("eve", verb, "").acted is False
        served.start(LONG)
        served.until(lambda status: status.step == "go")
        assert served.service.stop("eve", verb, "smoke").acted is True
        assert served.service.stop("eve", verb, "smoke").acted is False
        last = served.until_idle().last
        assert last is not None
        assert (last.ending, last.reason, last.exit_code) == (ending, f"{verb} by eve: smoke", 5)
    assert word(served.axis) == "safe"
    assert [line["what"] for line in served.audited()] == ["lease_take", "start", verb]


def test_an_estop_waits_for_no_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def hang(*_: object) -> None:
        raise AssertionError("a stop was written down before it was answered")

    with ServedAxis(tmp_path) as served:
        served.start(LONG)
        with monkeypatch.context() as broken:
            broken.setattr(served.audit, "write", hang)
            assert served.service.stop("eve", "stop", "").acted
            assert served.service.stop("eve", "estop", "").acted
        served.until_idle()
    assert [line["what"] for line in served.audited()[2:]] == ["stop", "estop"]


def test_who_has_vanished_before_the_run_begins_begins_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nobody would stop it: that its client has vanished was told when nothing ran."""
    with ServedAxis(tmp_path) as served:
        monkeypatch.setattr(served.trips, "begin_run", lambda: vanish(served))
        with pytest.raises(Refusal) as refused:
            served.start(LONG)
        assert refused.value.code is Code.NO_LEASE
        assert served.status.state == "idle"


def test_a_stop_while_devices_are_opened_is_heeded(tmp_path: Path) -> None:
    with ServedAxis(tmp_path, opens_in_s=20.0) as served:
        served.start()
        served.until(lambda status: served.axis.exists())
        served.service.stop("eve", "stop", "")
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


def test_prompts_are_answered_by_who_has_the_lease(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        run = served.start(ASKING)
        first = served.until(lambda status: status.prompt).prompt
        assert first is not None
        assert (first.name, first.unit, first.low, first.high, first.answer) == (
            "put_load", "kg", 0.0, 5.0, 1.0,
        )  # fmt: skip
        with pytest.raises(Refusal, match=r"7 kg is outside 0 kg \.\. 5 kg"):
            served.command("answer", prompt_id=first.id, value=7.0)
        with pytest.raises(Refusal, match="wants a number in kg"):
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


def test_a_stop_takes_the_prompt_away(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(ASKING)
        served.until(lambda status: status.prompt)
        served.service.stop("eve", "stop", "")
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "stopped"
        assert served.status.prompt is None


def test_the_procedures_own_answers_are_taken_where_that_is_asked_for(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(ASKING, answers="procedure")
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


def vanish(served: ServedAxis) -> None:
    """The client shows life no more."""
    served.clock.ahead_ns += round(LEASE_S * 1e9)
    served.service.tend()


def test_a_run_whose_client_vanishes_is_stopped_by_default(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(LONG)
        served.until(lambda status: status.step == "go")
        vanish(served)
        last = served.until_idle().last
        assert last is not None
        assert (last.ending, last.run) == ("stopped", served.ask("runs")["runs"][0]["run"])
        assert "alice, who steered this run, has vanished" in last.reason
    assert ("alice", "lease_lost", "the run is stopped") in [
        (line["who"], line["what"], line["result"]) for line in served.audited()
    ]


def test_a_run_whose_page_is_closed_names_the_person(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.command("lease_take", "panel", user="Ada")
        served.command("start", "panel", user="Ada", procedure=travelling(LONG))
        served.until(lambda status: status.step == "go")
        served.command("lease_renew", "panel", user="Bob")  # to whom Ada handed it over
        vanish(served)
        last = served.until_idle().last
        assert last is not None
        assert "Bob's page (panel) was closed or cut off" in last.reason
        assert "Bob's page (panel) was closed or cut off: the run is stopped" in [
            notice.text for notice in served.status.notices
        ]
    assert ("panel", "Bob", "lease_lost") in [
        (line["who"], line.get("user"), line["what"]) for line in served.audited()
    ]


def test_a_run_may_end_its_trial_when_its_client_vanishes(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(set={"time": "2 s"}, on_client_loss="finish_trial")
        served.until(lambda status: status.step == "go")
        vanish(served)
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "stopped"
        (line,) = served.ask("runs")["runs"]
        assert line["trials_done"] == 1


def test_a_run_may_go_on_when_its_client_vanishes(tmp_path: Path) -> None:
    text = f"{SWEEP}on_client_loss: continue\n"
    with ServedAxis(tmp_path) as served:
        served.start(text)
        served.until(lambda status: status.step == "go")
        vanish(served)
        assert served.status.lease.holder is None
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


def test_nobody_answers_a_prompt_of_a_trial_that_is_only_to_end(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(ASKING, on_client_loss="finish_trial")
        served.until(lambda status: status.prompt)
        vanish(served)
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "stopped"


def test_who_comes_back_may_let_the_run_go_on(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(set={"time": "1 s"}, on_client_loss="finish_trial")
        served.until(lambda status: status.step == "go")
        vanish(served)
        served.command("lease_take", "bob")
        served.command("resume", "bob")
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


def test_whoever_has_taken_over_steers_the_run_of_one_who_has_vanished(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start()
        served.until(lambda status: status.step == "go")
        served.clock.ahead_ns += round(LEASE_S * 1e9)
        served.command("lease_take", "bob")  # before the daemon came to look whose lease ran out
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


def test_who_gives_the_lease_back_has_not_vanished(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start()
        served.command("lease_release")
        vanish(served)
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


FAR = Interlock("far", "axis.position", high=0.005, action=Severity.ABORT, message="too far out")


def test_after_a_trip_nothing_starts_before_it_is_acknowledged(tmp_path: Path) -> None:
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
        served.command("acknowledge", interlock="far")
        assert served.status.trips[0].acknowledged
        with pytest.raises(Refusal, match="nothing to acknowledge"):
            served.command("acknowledge", interlock="far")
        served.start(SWEEP.replace("m/s, 0.2 m/s, 0.3 m/s]", "m/s]"))  # not as far
        status = served.until_idle()
        assert status.last is not None
        assert status.last.ending == "complete"
        assert status.trips == ()


def test_a_blocked_run_says_why(tmp_path: Path) -> None:
    near = Interlock("near", "axis.position", low=0.05, action=Severity.ABORT)
    with ServedAxis(tmp_path, interlocks=(near,)) as served:
        served.start()
        last = served.until_idle().last
        assert last is not None
        assert (last.ending, last.exit_code, last.recorded) == ("blocked", 3, False)
        assert "near stands violated at rest" in last.reason
        assert not list(served.runs.glob("*.mcap"))


def test_what_is_wrong_in_a_procedure_is_told_with_its_place(tmp_path: Path) -> None:
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


def test_nothing_starts_that_could_not_be_audited(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.command("lease_take")
        served.audit.path = tmp_path / "no such folder" / "audit.jsonl"
        with pytest.raises(Refusal, match="nobody could tell who did this"):
            served.command("start", procedure=travelling(SWEEP))
        assert served.status.state == "idle"
        assert served.service.stop("eve", "stop", "").acted is False
        for _ in range(2):
            served.service.tend()
        told = [notice.text for notice in served.status.notices if notice.level == "error"]
        assert told == [f"nothing can start: {served.audit.broken}"]


def test_a_resumed_run_may_go_on_alone(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        run = served.start(set={"time": "0.5 s"}, answers="procedure")
        served.until(lambda status: status.trials_done == 1 and status.step == "go")
        served.service.stop("eve", "abort", "")
        served.until_idle()
        served.command("resume_run", run=run, on_client_loss="continue")
        served.until(lambda status: status.step == "go")
        vanish(served)
        assert "alice has vanished: the run goes on" in [
            notice.text for notice in served.status.notices
        ]
        last = served.until_idle().last
        assert last is not None
        assert "vanished" not in last.reason


def test_a_run_that_was_interrupted_is_offered_and_gone_on_with(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        run = served.start(set={"time": "0.5 s"}, answers="procedure")
        served.until(lambda status: status.trials_done == 1 and status.step == "go")
        served.service.stop("eve", "abort", "")
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
    info = run_info(Recording.open(served.runs / run))
    assert sorted(trial.number for trial in info.trials if trial.complete) == [1, 2, 3]


def test_a_daemon_that_ends_stops_the_run_and_begins_nothing(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        run = served.start(LONG)
        served.until(lambda status: status.step == "go")
        assert served.steering.leave("stopped by SIGTERM") is not None
        served.steering.close()
        with pytest.raises(Refusal, match="the daemon is ending: stopped by SIGTERM"):
            served.start(SWEEP)
    assert run_info(Recording.open(served.runs / run)).reason == "stopped by SIGTERM"


def test_what_does_not_change_is_described(tmp_path: Path) -> None:
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


def test_the_status_can_always_be_told(tmp_path: Path) -> None:
    """Whatever stands in it, it is a message that a client can read."""
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


def test_a_check_of_too_many_steps_is_refused_at_once(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        found = served.ask("check", procedure=travelling(sweep_of(500, 16_000)), set={})
    told = "16000 trials of 500 steps are 8000000 steps, more than 200000"
    assert [item["message"] for item in found["problems"]] == [told]
    assert found["problems"][0]["line"] == 7


def test_a_folder_removed_during_a_run_spoils_no_later_run(tmp_path: Path) -> None:
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
        assert run_info(Recording.open(served.runs / again)).state == "complete"
