"""``rigd remote`` as a user meets it: processes, on a rig served over a real network."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import pytest
from support.answering_rig import (
    FILE,
    QUESTION,
    RECORDING,
    REPORT,
    RUN_PAGE,
    TEXT,
    Served,
    served,
)  # fmt: skip
from support.command import Ended, rigd, start

from rigd.remote.protocol.arguments import Answered, NoArguments, StartArguments
from rigd.remote.protocol.status import Interrupted, TripView

T = TypeVar("T")


@pytest.fixture
def remote() -> Iterator[Served]:
    with served() as found:
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
        self.remote.show()
        where = ("--endpoint", self.remote.endpoint, "--as", identity)
        ended = rigd("remote", *words, *where, cwd=self.folder)
        assert ended.code == code, ended
        return ended


def until(look: Callable[[], T], true: Callable[[T], bool]) -> None:
    deadline_s = time.monotonic() + 60.0
    while not true(seen := look()):
        assert time.monotonic() < deadline_s, seen
        time.sleep(0.02)


def test_status_shows_what_a_person_must_know(ask: Asking) -> None:
    rig = ask.remote.rig
    rig.running, rig.prompt = "a.mcap", QUESTION
    rig.interrupted = (Interrupted(run="b.mcap", reason="x", trials_done=1, trials_total=3),)
    rig.lease.obey("bob", "lease_take", NoArguments())
    shown = ask("status").out
    for text in ("lugre-1: running", "recording a.mcap", "waits for an answer: Put the weight on",
                 "control: bob", "interrupted: b.mcap, 1 of 3 trials"):  # fmt: skip
        assert text in shown
    status = ask("status", "--json").json
    assert (status["state"], status["prompt"]["id"]) == ("running", 7)


def test_start_takes_control_for_as_long_as_it_needs(ask: Asking) -> None:
    (ask.folder / "mine.yaml").write_text(TEXT)
    said = ("--note", "wheel cleaned", "--meta", "specimen=W7")
    out = ask("start", "mine.yaml", "--set", "floor=pvc", "--yes", "--seed", "7", *said).out
    assert f"rigd remote status --watch --endpoint {ask.remote.endpoint} --as alice" in out
    rig = ask.remote.rig
    assert rig.verbs() == ["lease_take", "start", "lease_release"]
    args = next(args for _, verb, args in rig.done if verb == "start")
    assert isinstance(args, StartArguments)
    assert (args.procedure, args.set, args.seed, args.answers) == (
        FILE, {"floor": "pvc"}, 7, "procedure",
    )  # fmt: skip
    assert (args.note, args.meta) == ("wheel cleaned", {"specimen": "W7"})
    assert rig.running is not None


def test_a_name_is_the_daemons_and_a_file_of_that_name_here_is_not_passed_over_in_silence(
    ask: Asking,
) -> None:
    (ask.folder / "procedures").mkdir()
    (ask.folder / "small.yaml").write_text(TEXT)
    assert ask("start", "small").err == ""  # the same
    (ask.folder / "small.yaml").write_text(f"{TEXT}# edited\n")
    assert "as the daemon has it; to start yours, give its path: small.yaml" in (
        ask("start", "small").err
    )
    (ask.folder / "procedures" / "mine.yaml").write_text(TEXT)
    assert "give its path: procedures/mine.yaml" in ask("start", "mine", code=2).err


def test_a_file_that_is_wrong_is_told_with_its_place_before_anything_is_sent(ask: Asking) -> None:
    (ask.folder / "mine.yaml").write_text(TEXT.replace("steps:", "stepz:"))
    assert "mine.yaml:7:3: unknown key 'stepz'" in ask("start", "mine.yaml", code=2).err
    assert ask.remote.rig.verbs() == []


def test_each_command_to_a_run(ask: Asking) -> None:
    rig = ask.remote.rig
    rig.running, rig.prompt = "a.mcap", QUESTION
    for words in (["pause"], ["resume"], ["ack", "overrun"]):
        ask(*words)
    assert "needs the role maintainer" in ask("act", "scale", "tare", code=3).err
    ask("act", "scale", "tare", identity="carol")
    assert ask("answer", "1200 g").out == "weight: 1200 g\n"
    given = [args.value for _, _, args in rig.done if isinstance(args, Answered)]
    assert given == [1.2]
    assert rig.lease.view().holder is None


def test_an_answer_that_cannot_be_is_told_and_control_given_back(ask: Asking) -> None:
    ask.remote.rig.prompt = QUESTION
    assert "is not in kg" in ask("answer", "3 m", code=2).err
    assert "no such prompt" in ask("answer", "1 kg", "--id", "3", code=3).err
    assert ask.remote.rig.lease.view().holder is None


@pytest.mark.parametrize("verb", ["stop", "abort", "estop"])
def test_stopping_needs_no_control(ask: Asking, verb: str) -> None:
    rig = ask.remote.rig
    rig.running = "a.mcap"
    rig.lease.obey("bob", "lease_take", NoArguments())
    assert ask(verb, "--reason", "smoke").out == f"{verb}: asked for\n"
    assert rig.done == [("alice", verb, "smoke")]
    assert ask(verb, "--json").json == {"acted": False}


def test_what_another_has_is_told(ask: Asking) -> None:
    ask.remote.rig.lease.obey("bob", "lease_take", NoArguments())
    err = ask("pause", code=3).err
    assert "bob has the control lease" in err
    assert "bob has control, for another" in ask("lease").out
    words = ["remote", "lease", "request", "--endpoint", ask.remote.endpoint, "--as", "alice"]
    asking = start(words, ask.folder)
    until(ask.remote.rig.lease.view, lambda lease: lease.asked_by == ("alice",))
    assert ask("lease", "give", "alice", identity="bob").out.startswith("alice has control")
    until(ask.remote.rig.verbs, lambda verbs: verbs.count("lease_take") == 2)  # pause, and this
    asking.signal(signal.SIGINT)
    assert asking.end().out.endswith("alice has control of lugre-1 until Ctrl-C gives it back\n"
                                     "given back\n")  # fmt: skip
    assert ask("lease").out == "nobody has control\n"


def test_events_and_recordings(ask: Asking) -> None:
    ask.remote.tell("step", name="one")
    ask.remote.tell("trial_start", number=1, parameters={"current": 0.3}, units={"current": "A"})
    ask.remote.tell("devices", scale="", drive="")
    ask.remote.tell("command", who="eve", verb="start", args={"set": {"floor": "\n\x1b[2Jfake"}})
    lines = ask("events").out.splitlines()
    assert [" ".join(line.split()[2:]) for line in lines] == [
        "step one", "trial_start number 1; current 0.3 A", "devices scale, drive",
        "command eve: start set floor [2Jfake",
    ]  # fmt: skip
    assert json.loads(ask("events", "--json").out.splitlines()[0])["data"] == {"name": "one"}
    assert "a.mcap" in ask("runs").out
    assert ask("runs", "--json").json["runs"][0]["run"] == "a.mcap"
    assert ask("fetch", "a.mcap", "--to", "data").out == "data/a.mcap\n"
    assert (ask.folder / "data" / "a.mcap").read_bytes() == RECORDING
    assert ask("report", "a.mcap", "--make", "--json").json == {"path": "a.html", "size": 36}
    assert (ask.folder / "a.html").read_bytes() == REPORT
    assert "identify" in ask.remote.rig.verbs()
    assert ask("report", "a.mcap").out == "a-run.html\n"
    assert (ask.folder / "a-run.html").read_bytes() == RUN_PAGE
    made = ask("report", "plain.mcap", "--make")  # it says nothing of an identification
    assert made.out == "plain-run.html\n"
    assert ask.remote.rig.verbs().count("identify") == 1


def test_procedures_and_dry_runs(ask: Asking) -> None:
    assert "small" in ask("procedures").out
    assert "fit to run" in ask("dry-run", "small").out
    assert ask("dry-run", "small", "--json").json["duration_s"] == 2.0


def test_a_trip_is_shown_with_what_to_do(ask: Asking) -> None:
    trip = TripView(
        interlock="overrun", action="abort", message="beyond the end", since_ns=1,
        latched=True, acknowledged=False,
    )  # fmt: skip
    ask.remote.rig.trips = (trip,)
    assert "overrun acted (abort): beyond the end; rigd remote ack overrun" in ask("status").out


def test_list_shows_who_is_alive_and_why_not(ask: Asking, tmp_path: Path) -> None:
    config = tmp_path / "config" / "rigd"
    config.mkdir(parents=True)
    (config / "remotes.yaml").write_text(
        f"remotes:\n  lugre-1: {{endpoint: {ask.remote.endpoint}}}\n"
        "  gone-1: {endpoint: tcp/127.0.0.1:9}\n"
    )
    found = {item["rig"]: item for item in rigd("remote", "list", "--json", cwd=tmp_path).json}
    assert found["lugre-1"]["status"]["state"] == "idle"
    assert found["gone-1"]["alive"] is False
    assert "nobody lets us in" in found["gone-1"]["problem"]
    # By its name in the list, no address is needed.
    assert rigd("remote", "status", "--rig", "lugre-1", cwd=tmp_path).code == 0


def test_nobody_there_is_exit_code_4(tmp_path: Path) -> None:
    ended = rigd("remote", "status", "--endpoint", "tcp/127.0.0.1:9", cwd=tmp_path)
    assert ended.code == 4
    assert "nobody lets us in at tcp/127.0.0.1:9" in ended.err


def test_certificates_are_made_and_what_to_write_is_shown(tmp_path: Path) -> None:
    words = ("remote", "setup-tls", "certs", "--host", "127.0.0.1", "--client", "alice")
    out = rigd(*words, cwd=tmp_path).out
    assert (tmp_path / "certs" / "alice.key").stat().st_mode & 0o077 == 0
    assert "roles: {alice: operator}" in out
    again = rigd(*words, "--client", "bob", "--json", cwd=tmp_path).json
    assert again["made"] == ["certs/bob.crt", "certs/bob.key"]
    assert rigd("remote", "setup-tls", "other", cwd=tmp_path).code == 2
