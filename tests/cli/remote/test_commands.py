"""``rigd remote`` as a user meets it: processes, on a rig served over a real network."""

from __future__ import annotations

import json
import re
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import pytest
from support.commands.command import Ended, rigd, start
from support.daemon.served_rig import Served, free_port, serve
from support.panel.played_campaign import FILE, RECORDING, REPORT, RUN_PAGE, TEXT, TRIP, WEIGH
from support.panel.played_rig import LEASE_S, RUN, WAITS, PlayedRig

from rigd.cli.remote.rigs import show_rigs
from rigd.config.remote import RemoteSetup
from rigd.engine.shared import RunFolder
from rigd.engine.shared.folder import STATE_VARIABLE
from rigd.remote.protocol import ClientUser, as_json
from rigd.remote.protocol.status import CertificateView, Interrupted, TripView

T = TypeVar("T")


@pytest.fixture
def remote() -> Iterator[Served]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with serve(RemoteSetup((endpoint,), roles={"carol": "maintainer"})) as found:
        yield found


@pytest.fixture
def ask(remote: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Asking]:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    yield Asking(remote, tmp_path)


class Asking:
    """Runs ``rigd remote ...`` on the served rig."""

    def __init__(self, remote: Served, folder: Path) -> None:
        self.remote = remote
        self.folder = folder

    def __call__(self, *words: str, identity: str = "alice", code: int = 0) -> Ended:
        self.remote.rig.show()
        where = ("--endpoint", self.remote.endpoint, "--as", identity)
        ended = rigd("remote", *words, *where, cwd=self.folder)
        assert ended.code == code, ended
        return ended


def until(look: Callable[[], T], true: Callable[[T], bool]) -> None:
    deadline_s = time.monotonic() + 60.0
    while not true(seen := look()):
        assert time.monotonic() < deadline_s, seen
        time.sleep(0.02)


def test_list_names_the_only_address_that_it_asks(capsys: pytest.CaptureFixture[str]) -> None:
    """A rig that this user does not serve here is found elsewhere by its entry alone."""
    show_rigs([])
    told = " ".join(capsys.readouterr().out.split())
    assert told.startswith("no rig at tcp/127.0.0.1:7447, and no entry in ")
    assert "a rig of another computer or user at another address needs an entry" in told


def test_status_tells_of_pauses_and_certificates(ask: Asking) -> None:
    rig = ask.remote.rig
    rig.run, rig.state = RUN, "pausing"
    rig.certificates = (
        CertificateView(whose="client", name="bob", until_ns=1_700_000_000_000_000_000),
    )
    shown = ask("status").out
    assert "pauses in 12 s at the latest" in shown
    assert re.search(r"certificate of the client, bob: expired on 2023-11-1[45]", shown)
    rig.state = "paused"
    assert f"  {WAITS}\n" in ask("status").out


def test_status_shows_state_prompt_and_holder(ask: Asking) -> None:
    rig = ask.remote.rig
    rig.state, rig.prompt = "running", WEIGH
    rig.interrupted = (Interrupted(run="b.mcap", reason="x", trials_done=1, trials_total=3),)
    rig.lease.take(ClientUser.of("bob"))
    shown = ask("status").out
    for text in ("lugre-1: running", f"recording {RUN}", f"waits for an answer: {WEIGH.text}",
                 "control: bob", "interrupted: b.mcap, 1 of 3 trials"):  # fmt: skip
        assert text in shown
    status = ask("status", "--json").json
    assert (status["state"], status["prompt"]["id"]) == ("running", WEIGH.id)


def test_start_holds_control_only_as_long_as_needed(ask: Asking) -> None:
    (ask.folder / "mine.yaml").write_text(TEXT)
    said = ("--note", "wheel cleaned", "--meta", "batch=13", "--specimen", "W7")
    out = ask("start", "mine.yaml", "--set", "floor=pvc", "--yes", "--seed", "7", *said).out
    assert f"rigd remote status --watch --endpoint {ask.remote.endpoint} --as alice" in out
    rig = ask.remote.rig
    assert rig.verbs() == ["lease_take", "start", "lease_release"]
    assert rig.given("start") == [
        {
            "procedure": as_json(FILE), "set": {"floor": "pvc"}, "seed": 7, "answers": "procedure",
            "note": "wheel cleaned", "meta": {"batch": "13"}, "specimen": "W7",
        }
    ]  # fmt: skip
    assert rig.state == "running"


def test_start_tells_who_answers_prompts(ask: Asking) -> None:
    (ask.folder / "mine.yaml").write_text(TEXT)
    for words, told in (
        (("start", "mine.yaml"), "prompts wait for an answer"),
        (("start", "mine.yaml", "--yes"), "the procedure answers its prompts"),
        (("resume-run", RUN), "answered as before the interruption"),
    ):
        ask.remote.rig.state = "idle"
        assert told in ask(*words).out


def test_resumed_run_takes_action_on_client_loss(ask: Asking) -> None:
    ask("resume-run", RUN, "--on-client-loss", "finish_trial")
    assert ask.remote.rig.given("resume_run") == [{"run": RUN, "on_client_loss": "finish_trial"}]


def test_start_by_name_warns_of_differing_local_file(
    ask: Asking,
) -> None:
    (ask.folder / "procedures").mkdir()
    (ask.folder / "quick.yaml").write_text(TEXT)
    assert ask("start", "quick").err == ""  # the same
    ask.remote.rig.end()
    (ask.folder / "quick.yaml").write_text(f"{TEXT}# edited\n")
    assert "as the daemon has it; to start your own file, give its path: quick.yaml" in (
        ask("start", "quick").err
    )
    (ask.folder / "procedures" / "mine.yaml").write_text(TEXT)
    assert "give its path: procedures/mine.yaml" in ask("start", "mine", code=2).err


def test_wrong_file_is_reported_with_place_before_sending(ask: Asking) -> None:
    (ask.folder / "mine.yaml").write_text(TEXT.replace("steps:", "stepz:"))
    told = ask("start", "mine.yaml", code=2).err
    assert re.search(r"mine\.yaml:\d+:\d+: unknown key 'stepz'", told)
    assert ask.remote.rig.verbs() == []


@pytest.mark.parametrize("verb", ["start", "dry-run"])
def test_path_never_means_a_shipped_file(ask: Asking, verb: str) -> None:
    told = ask(verb, "procedures/quick.yaml", code=2).err
    assert "file 'procedures/quick.yaml' does not exist" in told
    assert "give its name: quick" in told
    assert ask.remote.rig.verbs() == []


def test_run_commands_reach_rig_and_need_role(ask: Asking) -> None:
    rig = ask.remote.rig
    rig.state, rig.prompt = "running", WEIGH
    for words in (["pause"], ["resume"], ["ack", TRIP.interlock]):
        ask(*words)
    assert "needs the role maintainer" in ask("act", "scale", "tare", code=3).err
    ask("act", "scale", "tare", identity="carol")
    assert ask("answer", "1200 g").out == "weigh: 1200 g\n"
    assert [args["value"] for args in rig.given("answer")] == [1.2]
    assert rig.lease.view().holder is None


def test_impossible_answer_is_reported_and_control_released(ask: Asking) -> None:
    ask.remote.rig.prompt = WEIGH
    assert "'3 m' is not in g: write a quantity in g" in ask("answer", "3 m", code=2).err
    assert "no such prompt" in ask("answer", "1 kg", "--id", "3", code=3).err
    assert ask.remote.rig.lease.view().holder is None


@pytest.mark.parametrize("verb", ["stop", "abort", "estop"])
def test_stopping_needs_no_control(ask: Asking, verb: str) -> None:
    rig = ask.remote.rig
    rig.state = "running"
    rig.lease.take(ClientUser.of("bob"))
    assert ask(verb, "--reason", "smoke").out == f"{verb}: asked for\n"
    assert (rig.done, rig.given(verb)) == ([("alice", verb)], [{"reason": "smoke"}])
    assert ask(verb, "--json").json == {"acted": False}


def test_holder_of_the_lease_is_named(ask: Asking) -> None:
    ask.remote.rig.lease.take(ClientUser.of("bob"))
    err = ask("pause", code=3).err
    assert "bob has the control lease" in err
    assert "bob has control, for another" in ask("lease").out
    words = ["remote", "lease", "request", "--endpoint", ask.remote.endpoint, "--as", "alice"]
    asking = start(words, ask.folder)
    until(ask.remote.rig.lease.view, lambda lease: lease.asked_by == (ClientUser.of("alice"),))
    assert ask("lease", "give", "alice", identity="bob").out.startswith("alice has control")
    until(ask.remote.rig.verbs, lambda verbs: verbs.count("lease_take") == 2)  # pause, and this
    asking.signal(signal.SIGINT)
    assert asking.end().out.endswith("alice has control of lugre-1 until Ctrl-C gives it back\n"
                                     "given back\n")  # fmt: skip
    assert ask("lease").out == "no client has control\n"


def test_time_of_lease_follows_clock_of_rig(tmp_path: Path) -> None:
    setup = RemoteSetup((f"tcp/127.0.0.1:{free_port()}",))
    ahead = PlayedRig(wall=lambda: time.time_ns() + 3_600_000_000_000)
    ahead.hold_lease("bob")
    with serve(setup, rig=ahead) as remote:
        out = Asking(remote, tmp_path)("lease").out
    found = re.match(r"bob has control, for another ([\d.]+) s", out)
    assert found is not None, out
    assert 0.0 < float(found[1]) <= LEASE_S + 1.0


def test_events_and_recordings_are_listed(ask: Asking) -> None:
    ask.remote.rig.emit("step", name="one")
    ask.remote.rig.emit(
        "trial_start", number=1, parameters={"current": 0.3}, units={"current": "mA"}
    )
    ask.remote.rig.emit("devices", scale="", drive="")
    ask.remote.rig.emit(
        "command", who="eve", verb="start", args={"set": {"floor": "\n\x1b[2Jfake"}}
    )
    lines = ask("events").out.splitlines()
    assert [" ".join(line.split()[2:]) for line in lines] == [
        "step one", "trial_start number 1; current 300 mA", "devices scale, drive",
        "command eve: start set floor [2Jfake",
    ]  # fmt: skip
    assert json.loads(ask("events", "--json").out.splitlines()[0])["data"] == {"name": "one"}
    run, plain = ask.remote.rig.runs[0].run, ask.remote.rig.runs[2].run
    stem = run.removesuffix(".mcap")
    assert run in ask("runs").out
    assert ask("runs", "--json").json["runs"][0]["run"] == run
    assert ask("fetch", run, "--to", "data").out == f"data/{run}\n"
    assert (ask.folder / "data" / run).read_bytes() == RECORDING
    made = ask("report", run, "--make", "--json").json
    assert made == {"path": f"{stem}.html", "size": len(REPORT)}
    assert (ask.folder / f"{stem}.html").read_bytes() == REPORT
    assert "identify" in ask.remote.rig.verbs()
    assert ask("report", run).out == f"{stem}-run.html\n"
    assert (ask.folder / f"{stem}-run.html").read_bytes() == RUN_PAGE
    made = ask("report", plain, "--make").out  # it has no identification
    assert made == f"{plain.removesuffix('.mcap')}-run.html\n"
    assert ask.remote.rig.verbs().count("identify") == 1


def test_procedures_are_listed_and_dry_run(ask: Asking) -> None:
    assert "quick" in ask("procedures").out
    assert "fit to run" in ask("dry-run", "quick").out
    assert ask("dry-run", "quick", "--json").json["duration_s"] == 93.4


def test_trip_is_shown_with_its_remedy(ask: Asking) -> None:
    trip = TripView(
        interlock="overrun", action="abort", message="beyond the end", since_ns=1,
        latched=True, acknowledged=False,
    )  # fmt: skip
    ask.remote.rig.trips.append(trip)
    assert "overrun acted (abort): beyond the end; rigd remote ack overrun" in ask("status").out
    assert ask("ack", "overrun").out.startswith("overrun is acknowledged: at ")
    assert ask.remote.rig.given("acknowledge") == [{"interlock": "overrun", "since_ns": 1}]
    ask.remote.rig.trips.append(trip)
    assert ask("ack", "overrun").out.endswith(", beyond the end\n")


def test_list_shows_reachable_rigs_and_errors(ask: Asking, tmp_path: Path) -> None:
    config = tmp_path / "config" / "rigd"
    config.mkdir(parents=True)
    (config / "remotes.yaml").write_text(
        f"remotes:\n  lugre-1: {{endpoint: {ask.remote.endpoint}}}\n"
        "  gone-1: {endpoint: tcp/127.0.0.1:9}\n"
    )
    found = {item["rig"]: item for item in rigd("remote", "list", "--json", cwd=tmp_path).json}
    assert found["lugre-1"]["status"]["state"] == "idle"
    assert found["gone-1"]["alive"] is False
    assert "no daemon admits this client" in found["gone-1"]["problem"]
    # By its name in the list, no address is needed.
    assert rigd("remote", "status", "--rig", "lugre-1", cwd=tmp_path).code == 0


def test_list_shows_rig_served_here_without_entry(
    ask: Asking, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(STATE_VARIABLE, str(tmp_path / "state"))
    held = RunFolder.take("lugre-1", command="rigd serve")
    held.mark("rigd serve", served=("lugre-1", ask.remote.endpoint))
    try:
        listed = rigd("remote", "list", "--json", cwd=tmp_path).json
        found = {item["rig"]: item for item in listed}["lugre-1"]
        assert found["endpoint"] == ask.remote.endpoint
        assert found["status"]["state"] == "idle"
    finally:
        held.release()


def test_missing_daemon_gives_exit_code_4(tmp_path: Path) -> None:
    ended = rigd("remote", "status", "--endpoint", "tcp/127.0.0.1:9", cwd=tmp_path)
    assert ended.code == 4
    assert "no daemon admits this client at tcp/127.0.0.1:9" in ended.err


def test_setup_tls_makes_certificates_and_shows_configuration(tmp_path: Path) -> None:
    words = ("remote", "setup-tls", "certs", "--host", "127.0.0.1", "--client", "alice")
    out = rigd(*words, cwd=tmp_path).out
    assert (tmp_path / "certs" / "alice.key").stat().st_mode & 0o077 == 0
    assert "roles: {alice: ROLE}" in out
    again = rigd(*words, "--client", "bob", "--json", cwd=tmp_path).json
    assert again["made"] == ["certs/bob.crt", "certs/bob.key"]
    assert rigd("remote", "setup-tls", "other", cwd=tmp_path).code == 2
