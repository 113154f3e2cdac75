"""The client of scripts, on a rig served over a real network."""

from __future__ import annotations

import asyncio
import inspect
import time
from collections.abc import Iterator
from pathlib import Path
from typing import get_type_hints

import pytest
from support.answering_rig import FILE, QUESTION, RECORDING, REPORT, TEXT, Served, frame_of

from rigd.model.errors import ConfigError, LinkError
from rigd.remote import AsyncClient, Client
from rigd.remote.protocol import VERBS, Code, Kind, Refusal, Role, encode_frame
from rigd.remote.protocol.arguments import Answered, NoArguments, StartArguments


@pytest.fixture
def client(remote: Served) -> Iterator[Client]:
    with Client(endpoint=remote.endpoint, identity="alice") as opened:
        yield opened


def test_the_only_rig_needs_no_name(client: Client) -> None:
    assert (client.rig, client.identity) == ("lugre-1", "alice")
    assert client.status().rig == "lugre-1"


def test_everything_that_can_be_asked_is_answered(client: Client) -> None:
    assert client.describe().role is Role.OPERATOR
    assert client.latest().values["scale.mass"].value == 1.5
    frame = client.history("scale")
    assert frame is not None and frame.high.tolist() == [[1.0, 2.0]]
    assert client.procedures().procedures[0].name == "small"
    assert client.procedure("small").procedure == FILE
    assert client.check("small").trials == 3
    assert client.runs().runs[0].run == "a.mcap"
    assert client.run("a.mcap").details == {"rig": "lugre-1"}
    assert client.lease().holder is None


def test_who_speaks_for_several_says_for_whom(remote: Served, client: Client) -> None:
    connection = client.asynchronous.connection
    client.run_async(connection.command("lease_take", {}, "Ada"))
    client.run_async(connection.stop("stop", "Olga"))
    client.stop("smoke")
    assert remote.rig.users == {"lease_take": "Ada", "stop": ""}
    assert remote.rig.done[-2:] == [("alice", "stop", ""), ("alice", "stop", "smoke")]


def test_a_procedure_travels_as_it_is_written(
    remote: Served, client: Client, tmp_path: Path
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(TEXT)
    with client.control():
        client.start(path, {"floor": "pvc"}, seed=3, answers="procedure")
    args = next(args for _, verb, args in remote.rig.done if verb == "start")
    assert isinstance(args, StartArguments)
    assert (args.procedure, args.set, args.seed, args.answers) == (
        FILE, {"floor": "pvc"}, 3, "procedure",
    )  # fmt: skip


def test_a_procedure_that_is_wrong_never_leaves(
    remote: Served, client: Client, tmp_path: Path
) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(TEXT.replace("steps:", "stepz:"))
    with client.control(brief=True), pytest.raises(ConfigError, match=r"mine\.yaml:7:3"):
        client.start(path)
    assert "start" not in remote.rig.verbs()


def test_a_run_from_start_to_end(remote: Served, client: Client) -> None:
    with client.control():
        run = client.start("small").run
        assert run is not None
        client.pause()
        client.resume()
        remote.rig.prompt = QUESTION
        client.answer(1.5, QUESTION.id)
        with pytest.raises(Refusal) as refused:
            client.answer(1.5, QUESTION.id)
        assert refused.value.code is Code.CONFLICT
        client.acknowledge("overrun")
        remote.rig.end()
        assert client.wait(run).ending == "complete"
    assert remote.rig.verbs() == [
        "lease_take", "start", "pause", "resume", "answer", "answer", "acknowledge",
        "lease_release",
    ]  # fmt: skip
    given = [args.value for _, _, args in remote.rig.done if isinstance(args, Answered)]
    assert given == [1.5, 1.5]


def test_whoever_looks_may_stop(remote: Served, client: Client) -> None:
    remote.rig.running = "a.mcap"
    assert client.stop("smoke") is True
    assert client.abort() is False
    assert client.estop() is False
    assert remote.rig.done[0] == ("alice", "stop", "smoke")


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
    assert status.lease.holder == "alice"
    client.lease_release()
    assert client.lease().holder is None
    renewals = [verb for _, verb, _ in remote.rig.done].count("lease_renew")
    assert renewals >= 1


def test_a_lease_that_was_taken_away_is_not_taken_back(remote: Served, client: Client) -> None:
    client.lease_take()
    remote.rig.lease.obey("carol", "lease_seize", NoArguments())
    deadline_s = time.monotonic() + 30
    while client.asynchronous._holding.holds and time.monotonic() < deadline_s:
        next(client.watch())
    assert not client.asynchronous._holding.holds
    assert client.lease().holder == "carol"
    with pytest.raises(Refusal, match="which carol has"):
        client.pause()


def test_two_clients_and_one_lease(remote: Served, client: Client) -> None:
    with Client(endpoint=remote.endpoint, identity="bob") as bob:
        client.lease_take()
        with pytest.raises(Refusal) as refused:
            bob.lease_take()
        assert refused.value.code is Code.LEASE_HELD
        assert bob.lease_request().asked_by == ("bob",)
        client.lease_give("bob")
        assert bob.lease().holder == "bob"
        bob.lease_take()
        with pytest.raises(Refusal, match="which bob has"):
            client.pause()


def test_control_leaves_a_lease_that_was_held_before(client: Client) -> None:
    client.lease_take()
    with client.control():
        client.pause()
    client.pause()


def test_control_left_by_an_error_is_not_given_back(client: Client) -> None:
    with pytest.raises(ZeroDivisionError), client.control():
        raise ZeroDivisionError
    assert client.lease().holder == "alice"  # it runs out: the daemon is to see a client vanish
    assert not client.asynchronous._holding.holds


def test_control_left_by_a_refusal_is_given_back(client: Client) -> None:
    with pytest.raises(Refusal), client.control():
        client.procedure("nonesuch")
    assert client.lease().holder is None


def test_control_that_another_was_given_meanwhile_is_theirs(client: Client) -> None:
    with client.control():
        client.run_async(client.asynchronous.connection.command("lease_give", {"to": "bob"}))
    assert client.lease().holder == "bob"


def test_brief_control_is_given_back_whatever_happens(client: Client) -> None:
    with pytest.raises(ZeroDivisionError), client.control(brief=True):
        raise ZeroDivisionError
    assert client.lease().holder is None


def test_events_are_told_as_they_happen_and_those_before_are_known(
    remote: Served, client: Client
) -> None:
    remote.tell("step", name="one")
    events = client.watch_events(0)
    remote.tell("step", name="two")
    assert [next(events).data["name"] for _ in range(2)] == ["one", "two"]
    assert client.events(1).next == 2


def test_live_data_is_handed_over_as_frames(remote: Served, client: Client) -> None:
    frames = client.watch_live("scale")
    client.status()  # the daemon has heard of the listening once it answers what came after it
    remote.server.publisher.frame("scale", encode_frame(frame_of(5)))
    frame = next(frames)
    assert (frame.sequence, frame.low.tolist()) == (5, [[1.0, 2.0]])


def test_recordings_come_in_pieces_and_go_on_where_they_broke_off(
    remote: Served, client: Client, tmp_path: Path
) -> None:
    remote.rig.breaks_at = 1
    with pytest.raises(Refusal, match="the disk fell off"):
        client.fetch("a.mcap", tmp_path)
    seen: list[tuple[int, int]] = []
    path = client.fetch("a.mcap", tmp_path, lambda done, size: seen.append((done, size)))
    assert path == tmp_path / "a.mcap"
    assert path.read_bytes() == RECORDING
    assert seen[-1] == (len(RECORDING), len(RECORDING)) and len(seen) == 3
    assert client.report("a.mcap", tmp_path).read_bytes() == REPORT


def test_a_notebooks_loop_is_left_alone(remote: Served) -> None:
    async def cell() -> str:
        with Client(endpoint=remote.endpoint) as rig:
            return rig.status().rig

    assert asyncio.run(cell()) == "lugre-1"


def test_iterating_may_be_left_and_begun_again(client: Client) -> None:
    for _ in range(3):
        for status in client.watch():
            assert status.rig == "lugre-1"
            break


def test_a_closed_client_says_so(remote: Served) -> None:
    client = Client(endpoint=remote.endpoint)
    client.close()
    client.close()
    with pytest.raises(LinkError, match="is closed"):
        client.status()


def test_what_cannot_be_asked_so_never_leaves(client: Client) -> None:
    for wrong in (lambda: client.runs(limit=1000), lambda: client.run("../secret")):
        with pytest.raises(Refusal) as refused:
            wrong()
        assert refused.value.code is Code.BAD_REQUEST


def test_what_is_not_a_rig_there_is_told(remote: Served) -> None:
    with pytest.raises(LinkError, match=r"there is no rig other at .*\n  there is lugre-1"):
        Client("other", endpoint=remote.endpoint)


def test_every_verb_has_its_method_in_both_clients() -> None:
    verbs = {name for table in VERBS.values() for name in table}
    for kind in (Client, AsyncClient):
        assert {name for name in verbs if not callable(getattr(kind, name, None))} == set()


def test_methods_return_what_the_table_of_verbs_says() -> None:
    unwrapped = {"act", "answer", "pause", "resume", "acknowledge", "history", "fetch", "report",
                 "stop", "abort", "estop"}  # fmt: skip
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
