"""A client that vanishes: its run ends, or goes on if it was started so."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.daemon.served_axis import ASKING, LONG, SWEEP, ServedAxis, travelling

from rigd.remote.protocol import ClientUser, Code, Refusal
from rigd.remote.protocol.limits import LEASE_S


def vanish(served: ServedAxis) -> None:
    """The client shows life no more."""
    served.clock.ahead_ns += round(LEASE_S * 1e9)
    served.service.tend()


def test_client_vanished_before_run_starts_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No one else would stop it: its client vanished while nothing ran."""
    with ServedAxis(tmp_path) as served:
        monkeypatch.setattr(served.trips, "begin_run", lambda: vanish(served))
        with pytest.raises(Refusal) as refused:
            served.start(LONG)
        assert refused.value.code is Code.NO_LEASE
        assert served.status.state == "idle"


def test_run_without_its_client_stops_by_default(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(LONG)
        served.until(lambda status: status.step == "go")
        vanish(served)
        last = served.until_idle().last
        assert last is not None
        assert (last.ending, last.run) == ("stopped", served.ask("runs")["runs"][0]["run"])
        assert "alice, who steered this run, gave no sign of life for 6 s" in last.reason
    assert ("alice", "lease_lost", "the run is stopped") in [
        (line["who"], line["what"], line["result"]) for line in served.audited()
    ]


def test_run_stopped_by_closed_page_names_person(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.command("lease_take", "panel", user="Ada")
        served.command("start", "panel", user="Ada", procedure=travelling(LONG))
        served.until(lambda status: status.step == "go")
        served.lease.request(ClientUser.of("panel", "Bob"))
        served.command("lease_give", "panel", user="Ada", to="panel")
        vanish(served)
        last = served.until_idle().last
        assert last is not None
        assert "Bob's page (panel) gave no sign of life for 6 s" in last.reason
        assert "Bob's page (panel) gave no sign of life for 6 s: the run is stopped" in [
            notice.text for notice in served.status.notices
        ]
    assert ("panel", "Bob", "lease_lost") in [
        (line["who"], line.get("user"), line["what"]) for line in served.audited()
    ]


def test_run_may_end_trial_if_its_client_vanishes(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(set={"time": "2 s"}, on_client_loss="finish_trial")
        served.until(lambda status: status.step == "go")
        vanish(served)
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "stopped"
        (line,) = served.ask("runs")["runs"]
        assert line["trials_done"] == 1


def test_run_may_continue_when_its_client_vanishes(tmp_path: Path) -> None:
    text = f"{SWEEP}on_client_loss: continue\n"
    with ServedAxis(tmp_path) as served:
        served.start(text)
        served.until(lambda status: status.step == "go")
        vanish(served)
        assert served.status.lease.holder is None
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


def test_ending_trial_gets_no_answer_to_its_prompt(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(ASKING, on_client_loss="finish_trial")
        served.until(lambda status: status.prompt)
        vanish(served)
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "stopped"


def test_returning_client_may_let_run_continue(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start(set={"time": "1 s"}, on_client_loss="finish_trial")
        served.until(lambda status: status.step == "go")
        vanish(served)
        served.command("lease_take", "bob")
        served.command("resume", "bob")
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


def test_new_lease_holder_steers_run_of_vanished_client(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start()
        served.until(lambda status: status.step == "go")
        served.clock.ahead_ns += round(LEASE_S * 1e9)
        served.command("lease_take", "bob")  # before the daemon came to look whose lease ran out
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


def test_client_that_releases_lease_is_not_lost(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        served.start()
        served.command("lease_release")
        vanish(served)
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "complete"


def test_resumed_run_can_continue_without_client(tmp_path: Path) -> None:
    with ServedAxis(tmp_path) as served:
        run = served.start(set={"time": "0.5 s"}, answers="procedure")
        served.until(lambda status: status.trials_done == 1 and status.step == "go")
        served.stop("eve", "abort")
        served.until_idle()
        served.command("resume_run", run=run, on_client_loss="continue")
        served.until(lambda status: status.step == "go")
        vanish(served)
        assert "alice gave no sign of life for 6 s: the run goes on" in [
            notice.text for notice in served.status.notices
        ]
        last = served.until_idle().last
        assert last is not None
        assert "sign of life" not in last.reason


def test_held_run_stops_if_its_client_vanishes(tmp_path: Path) -> None:
    text = LONG.replace("for: ${time}", "for: ${time}\n      hold: {timeout: 60 s}")
    with ServedAxis(tmp_path) as served:
        served.start(text, on_client_loss="finish_trial")
        served.until(lambda status: status.step == "go")
        served.command("pause")
        served.until(lambda status: status.state == "held")
        vanish(served)
        last = served.until_idle().last
        assert last is not None
        assert last.ending == "stopped"
