"""The client of scripts, on a rig served over a real network."""

from __future__ import annotations

import asyncio
import inspect
import time
from base64 import b64decode
from collections.abc import Iterator
from pathlib import Path
from typing import get_type_hints

import pytest
from support.daemon.served_rig import Served
from support.panel.played_campaign import FILE, RECORDING, REPORT, TEXT, TRIP, WEIGH, past
from support.panel.played_rig import EVENTS_OF_ANSWER

from rigd.model.errors import ConfigError, LinkError
from rigd.remote import AsyncClient, Client
from rigd.remote.client.lease import lease_keeper, renewing
from rigd.remote.protocol import VERBS, ClientUser, Code, Kind, LeaseView, Refusal, Role, as_json
from rigd.remote.protocol.results import Stopped


@pytest.fixture
def client(remote: Served) -> Iterator[Client]:
    with Client(endpoint=remote.endpoint, identity="alice") as opened:
        yield opened


def test_the_only_rig_needs_no_name(client: Client) -> None:
    assert (client.rig, client.identity) == ("lugre-1", "alice")
    assert client.status().rig == "lugre-1"


def test_every_question_is_answered(client: Client) -> None:
    assert client.describe().role is Role.OPERATOR
    assert client.latest().values["longitudinal_belt.engaged"].value == 1.0
    frame = client.history("carriage")
    assert frame is not None and frame.high.shape == (2, 100)
    assert FILE.name in [line.name for line in client.procedures().procedures]
    assert client.procedure(FILE.name).procedure == FILE
    assert client.check(FILE.name).trials == 10
    run = client.runs().runs[0].run
    assert client.run(run).details["seed"] == "1"
    assert client.lease().holder is None


def test_client_of_several_users_names_the_user(remote: Served, client: Client) -> None:
    connection = client.asynchronous.connection
    client.run_async(connection.request(Kind.COMMAND, "lease_take", {}, LeaseView, "Ada"))
    client.run_async(connection.request(Kind.STOP, "stop", {}, Stopped, "Olga"))
    client.stop("smoke")
    assert (remote.rig.users("lease_take"), remote.rig.users("stop")) == (["Ada"], ["Olga", ""])
    assert remote.rig.given("stop") == [{}, {"reason": "smoke"}]


def test_client_sends_procedure_text_unchanged(
    remote: Served, client: Client, tmp_path: Path
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(TEXT)
    with client.control():
        client.start(path, {"floor": "pvc"}, seed=3, answers="procedure")
    assert remote.rig.given("start") == [
        {"procedure": as_json(FILE), "set": {"floor": "pvc"}, "seed": 3, "answers": "procedure"}
    ]


def test_a_procedure_that_is_wrong_never_leaves(
    remote: Served, client: Client, tmp_path: Path
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(TEXT.replace("steps:", "stepz:"))
    with client.control(brief=True), pytest.raises(ConfigError, match=r"mine\.yaml:\d+:\d+"):
        client.start(path)
    assert "start" not in remote.rig.verbs()


def test_client_steers_run_from_start_to_end(remote: Served, client: Client) -> None:
    with client.control():
        run = client.start(FILE.name).run
        assert run is not None
        client.pause()
        client.resume()
        remote.rig.prompt = WEIGH
        client.answer(1.5, WEIGH.id)
        with pytest.raises(Refusal) as refused:
            client.answer(1.5, WEIGH.id)
        assert refused.value.code is Code.CONFLICT
        remote.rig.trips.append(TRIP.model_copy(update={"since_ns": 5000}))
        with pytest.raises(Refusal, match="tripped again since"):
            client.acknowledge(TRIP.interlock, since_ns=2000)
        client.acknowledge(TRIP.interlock)
        remote.rig.end()
        assert client.wait(run).ending == "complete"
    assert remote.rig.verbs() == [
        "lease_take", "start", "pause", "resume", "answer", "answer", "acknowledge", "acknowledge",
        "lease_release",
    ]  # fmt: skip
    assert [args["value"] for args in remote.rig.given("answer")] == [1.5, 1.5]


def test_stop_is_sent_with_any_reason(remote: Served, client: Client) -> None:
    remote.rig.state = "running"
    assert client.stop("smoke\udcff" + 100_000 * "!") is True
    assert remote.rig.given("stop") == [{"reason": "smoke " + 294 * "!"}]


def test_observer_may_stop(remote: Served, client: Client) -> None:
    remote.rig.state = "running"
    assert client.stop("smoke") is True
    assert client.stop() is False
    assert client.abort() is True
    assert client.estop() is False
    assert remote.rig.verbs() == ["stop", "stop", "abort", "estop"]


def test_commands_need_the_lease(remote: Served, client: Client) -> None:
    with pytest.raises(Refusal) as refused:
        client.pause()
    assert refused.value.code is Code.NO_LEASE
    assert remote.rig.verbs() == []


def test_a_lease_is_kept_while_it_is_held(remote: Served, client: Client) -> None:
    view = client.lease_take()
    first_ns = view.until_ns
    for status in client.watch():
        if status.lease.until_ns > first_ns + 1_000_000_000:
            break
    assert status.lease.is_held_by("alice")
    client.lease_release()
    assert client.lease().holder is None
    assert remote.rig.given("lease_renew")


def test_lease_taken_away_is_not_taken_back(remote: Served, client: Client) -> None:
    client.lease_take()
    remote.rig.lease.seize(ClientUser.of("carol"))
    deadline_s = time.monotonic() + 30
    while client.asynchronous._holding.holds and time.monotonic() < deadline_s:
        next(client.watch())
    assert not client.asynchronous._holding.holds
    assert client.lease().is_held_by("carol")
    with pytest.raises(Refusal, match="which carol has"):
        client.pause()


def test_lease_excludes_a_second_client(remote: Served, client: Client) -> None:
    with Client(endpoint=remote.endpoint, identity="bob") as bob:
        client.lease_take()
        with pytest.raises(Refusal) as refused:
            bob.lease_take()
        assert refused.value.code is Code.LEASE_HELD
        assert bob.lease_request().asked_by == (ClientUser.of("bob"),)
        client.lease_give("bob")
        assert bob.lease().is_held_by("bob")
        bob.lease_take()
        with pytest.raises(Refusal, match="which bob has"):
            client.pause()


def test_control_leaves_a_lease_that_was_held_before(client: Client) -> None:
    client.lease_take()
    with client.control():
        client.pause()
    client.pause()


@pytest.mark.parametrize("lives", [True, False])
def test_control_over_lease_of_killed_process_ends(
    remote: Served, client: Client, monkeypatch: pytest.MonkeyPatch, lives: bool
) -> None:
    """A process of the same name took the lease before, and renews it only if it lives."""
    monkeypatch.setattr(lease_keeper, "RENEW_S", 0.1)
    monkeypatch.setattr(renewing, "RENEW_S", 0.1)
    with Client(endpoint=remote.endpoint, identity="alice") as other:
        if lives:
            monkeypatch.setattr(lease_keeper, "_WAIT_PART", 50.0)  # it may be slow to renew
            other.lease_take()
        else:
            remote.rig.lease.take(ClientUser.of("alice"))
        with client.control():
            client.pause()
        assert client.lease().is_held_by("alice") is lives
    assert not client.asynchronous._holding.holds


def test_control_left_by_error_is_not_given_back(client: Client) -> None:
    with pytest.raises(ZeroDivisionError), client.control():
        raise ZeroDivisionError
    assert client.lease().is_held_by("alice")  # it runs out: the daemon is to see a client vanish
    assert not client.asynchronous._holding.holds


def test_control_left_by_a_refusal_is_given_back(client: Client) -> None:
    with pytest.raises(Refusal), client.control():
        client.procedure("nonesuch")
    assert client.lease().holder is None


def test_control_given_away_is_not_released(remote: Served, client: Client) -> None:
    with client.control():
        remote.rig.lease.request(ClientUser.of("bob"))
        connection = client.asynchronous.connection
        client.run_async(connection.request(Kind.COMMAND, "lease_give", {"to": "bob"}, LeaseView))
    assert client.lease().is_held_by("bob")


def test_brief_control_is_always_released(client: Client) -> None:
    with pytest.raises(ZeroDivisionError), client.control(brief=True):
        raise ZeroDivisionError
    assert client.lease().holder is None


def test_events_arrive_live_after_those_already_known(remote: Served, client: Client) -> None:
    remote.rig.emit("step", name="one")
    events = client.watch_events(0)
    remote.rig.emit("step", name="two")
    assert [next(events).data["name"] for _ in range(2)] == ["one", "two"]
    assert client.events(1).next == 2


def test_events_of_several_answers_come_complete(remote: Served, client: Client) -> None:
    for _ in range(2 * EVENTS_OF_ANSWER + 1):
        remote.rig.emit("step")
    found = client.events(1)
    assert [event.seq for event in found.events] == list(range(1, 2 * EVENTS_OF_ANSWER + 1))
    assert found.next == 2 * EVENTS_OF_ANSWER + 1


def test_live_data_is_handed_over_as_frames(remote: Served, client: Client) -> None:
    frames = client.watch_live("carriage")
    client.status()  # the daemon has heard of the listening once it answers what came after it
    remote.server.publisher.frame("carriage", b64decode(past("carriage")))
    assert next(frames).low.shape == (2, 100)


def test_recordings_come_in_pieces_and_resume_after_break(
    remote: Served, client: Client, tmp_path: Path
) -> None:
    run = remote.rig.runs[1].run

    def broken(done: int, size: int) -> None:
        remote.rig.fails, remote.rig.error = "fetch", Refusal(Code.INTERNAL, "the disk fell off")

    with pytest.raises(Refusal, match="the disk fell off"):
        client.fetch(run, tmp_path, broken)
    remote.rig.fails = ""
    seen: list[tuple[int, int]] = []
    path = client.fetch(run, tmp_path, lambda done, size: seen.append((done, size)))
    assert path == tmp_path / run
    assert path.read_bytes() == RECORDING
    assert seen[-1] == (len(RECORDING), len(RECORDING)) and len(seen) == 2
    assert client.report(run, tmp_path).read_bytes() == REPORT


def test_client_works_within_a_running_loop(remote: Served) -> None:
    async def cell() -> str:
        with Client(endpoint=remote.endpoint) as rig:
            return rig.status().rig

    assert asyncio.run(cell()) == "lugre-1"


def test_watch_can_be_left_and_restarted(client: Client) -> None:
    for _ in range(3):
        for status in client.watch():
            assert status.rig == "lugre-1"
            break


def test_closed_client_raises_an_error(remote: Served) -> None:
    client = Client(endpoint=remote.endpoint)
    client.close()
    client.close()
    with pytest.raises(LinkError, match="is closed"):
        client.status()


def test_invalid_request_is_never_sent(client: Client) -> None:
    for wrong in (lambda: client.runs(limit=1000), lambda: client.run("../secret")):
        with pytest.raises(Refusal) as refused:
            wrong()
        assert refused.value.code is Code.BAD_REQUEST


def test_missing_rig_is_reported(remote: Served) -> None:
    with pytest.raises(LinkError, match=r"no rig other at .*\n.*lugre-1"):
        Client("other", endpoint=remote.endpoint)


def test_every_verb_has_its_method_in_both_clients() -> None:
    verbs = {name for table in VERBS.values() for name in table}
    for kind in (Client, AsyncClient):
        assert {name for name in verbs if not callable(getattr(kind, name, None))} == set()


def test_methods_return_the_types_of_the_table() -> None:
    unwrapped = {"act", "answer", "pause", "resume", "acknowledge", "history", "fetch", "report",
                 "compare", "stop", "abort", "estop"}  # fmt: skip
    for kind in (Kind.ASK, Kind.COMMAND):
        for name, verb in VERBS[kind].items():
            if name not in unwrapped:
                returned = get_type_hints(getattr(AsyncClient, name))["return"]
                assert returned is verb.result, name


def test_both_clients_have_the_same_public_methods() -> None:
    def public(kind: type) -> set[str]:
        return {name for name, _ in inspect.getmembers(kind) if not name.startswith("_")}

    assert public(AsyncClient) - public(Client) == {"open", "connection"}
    assert public(Client) - public(AsyncClient) == {"run_async", "iterate"}
