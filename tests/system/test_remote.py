"""The whole way of a remote user: commands and Python, on the daemon of a simulated rig."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from itertools import takewhile
from pathlib import Path

import pytest
from support.commands.asking import ASKING
from support.commands.command import rigd, start
from support.commands.terminal import Terminal
from support.daemon.process import Daemon
from support.daemon.served_lugre import RIG, served_lugre

from rigd.record import Recording
from rigd.remote import Client
from rigd.remote.protocol import ClientUser, Code, Refusal
from rigd.remote.protocol.limits import LEASE_S

#: A crowded machine does everything within this.
PATIENCE_S = 90.0


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    with served_lugre(tmp_path_factory.mktemp("remote")) as served:
        yield served


@pytest.fixture(autouse=True)
def folder(daemon: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of one's own, with the procedure; the rig is found by its name."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(daemon.runs.parent))
    (tmp_path / "asking.yaml").write_text(ASKING)
    return tmp_path


def test_terminal_can_start_and_answer_a_run(folder: Path) -> None:
    terminal = Terminal.open(["remote", "start", "asking.yaml", "--watch"], folder)
    try:
        terminal.expect("lugre-1 records")
        terminal.expect("What does the scale show?")
        terminal.type("9 kg")
        terminal.expect("outside")  # the daemon's own words, before the run hears of it
        terminal.expect("What does the scale show?")
        terminal.type("3900 g")
        ending = terminal.expect("rigd remote fetch")
        assert "incomplete" not in ending, ending
        assert terminal.end() == 0
    finally:
        terminal.close()
    name = rigd("remote", "runs", "--limit", "1", "--json", cwd=folder).json["runs"][0]["run"]
    path = rigd("remote", "fetch", name, "--to", "data", cwd=folder).out.strip()
    info = Recording.open(folder / path).info
    assert (info.state, info.trials_done) == ("complete", 2)


def test_script_can_start_and_watch_a_run(folder: Path) -> None:
    with Client(RIG) as rig, rig.control():
        run = rig.start(folder / "asking.yaml", {"current": "0.2 A"}, answers="procedure").run
        assert run is not None
        goes_on = takewhile(lambda item: item.last is None or item.last.run != run, rig.watch())
        assert "running" in {status.state for status in goes_on}
        last = rig.wait(run)
        assert (last.ending, last.exit_code) == ("complete", 0)
        recording = Recording.open(rig.fetch(run, folder))
    parameters = recording.info.metadata["overrides"]
    assert parameters == {"current": "0.2 A"}


def test_ctrl_c_can_end_only_the_watching(daemon: Daemon, folder: Path) -> None:
    words = ["remote", "start", "asking.yaml", "--yes", "--watch", "--set", "time=7200 s"]
    terminal = Terminal.open(words, folder)
    try:
        terminal.expect("shake")
        terminal.process.send_signal(signal.SIGINT)
        terminal.expect("only stop watching")
        terminal.type("w")
        assert terminal.end() == 0
    finally:
        terminal.close()
    with Client(RIG, identity="bob") as rig:
        statuses = rig.watch()
        first_ns = next(statuses).t_ns
        late = next(status for status in statuses if (status.t_ns - first_ns) * 1e-9 > LEASE_S + 1)
        assert late.state == "running"  # no client has vanished
        assert rig.stop("enough") is True
        assert late.run is not None
        assert rig.wait(late.run).ending == "stopped"


def test_a_watching_command_that_is_killed_has_vanished(folder: Path) -> None:
    words = ["remote", "start", "asking.yaml", "--yes", "--watch", "--set", "time=7200 s"]
    running = start(words, folder)
    running.wait_for("trial 1/2")
    running.signal(signal.SIGKILL)
    running.end()
    with Client(RIG) as rig:
        run = rig.status().run
        assert run is not None
        last = rig.wait(run)
    assert last.ending == "stopped"
    assert "no sign of life" in last.reason


def test_second_client_cannot_take_the_lease(folder: Path) -> None:
    with Client(RIG, identity="ann") as ann, Client(RIG, identity="bob") as bob:
        with ann.control():
            with pytest.raises(Refusal) as refused, bob.control():
                pass
            assert refused.value.code is Code.LEASE_HELD
            bob.lease_request()
            assert next(item for item in ann.watch() if item.lease.asked_by).lease.asked_by == (
                ClientUser.of("bob"),
            )
            with pytest.raises(Refusal, match="bbo does not ask for the lease"):
                ann.lease_give("bbo")
            ann.lease_give("bob")
        with bob.control():
            assert bob.lease().is_held_by("bob")
        assert not bob.lease().is_held_by("bob")  # nobody renewed what ann gave


def test_procedure_that_cannot_run_gives_its_place(folder: Path) -> None:
    (folder / "wrong.yaml").write_text(
        ASKING.replace("wheel_servo.current:", "wheel_servo.curent:")
    )
    ended = rigd("remote", "start", "wrong.yaml", cwd=folder)
    assert ended.code == 2  # as that of `rigd check`
    assert "wrong.yaml:" in ended.err
    assert "asking.yaml" not in ended.err
    assert "wheel_servo.curent" in ended.err


def test_dry_run_elsewhere_is_same_as_here(daemon: Daemon, folder: Path) -> None:
    there = rigd("remote", "dry-run", "asking.yaml", "--json", cwd=folder)
    rig = daemon.runs.parent / "rig.yaml"
    here = rigd("run", "asking.yaml", "--rig", rig, "--dry-run", "--json", cwd=folder)
    assert (there.code, here.code) == (0, 0)
    assert there.json["steps"] == here.json["steps"]
    assert there.json["duration_s"] == pytest.approx(here.json["duration_s"])
