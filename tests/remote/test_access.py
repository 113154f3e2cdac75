"""Permissions: each verb of each role, over TLS sessions in processes of their own."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping

import pytest
from support.daemon.served_rig import Served, key, request
from support.daemon.zenoh_client import ZenohClient

from rigd.remote.protocol import VERBS

ASKS = (
    "describe", "events", "latest", "history", "lease", "procedures", "procedure", "check", "runs",
    "run", "report", "fetch", "compare",
)  # fmt: skip
STOPS = ("stop", "abort", "estop")
COMMANDS = (
    "lease_take", "lease_renew", "lease_request", "start", "pause", "resume", "answer",
    "acknowledge", "resume_run", "identify", "calibrate", "draw", "dry_run", "lease_give",
    "lease_release",
)  # fmt: skip
MAINTENANCE = ("act", "lease_seize")
NEED_LEASE = (
    "start", "pause", "resume", "answer", "acknowledge", "resume_run", "identify", "calibrate",
    "act",
)  # fmt: skip

#: What becomes of a verb: it reaches the rig, is refused with a reason, or is not even let in.
DONE, FORBIDDEN, SILENCE = "done", "forbidden", "silence"
TABLE: Mapping[str, Mapping[str, str]] = {
    "bob": {  # observer
        **{f"ask/{verb}": DONE for verb in ASKS},
        **{f"stop/{verb}": DONE for verb in STOPS},
        **{f"cmd/{verb}": SILENCE for verb in (*COMMANDS, *MAINTENANCE)},
    },
    "alice": {  # operator
        **{f"ask/{verb}": DONE for verb in ASKS},
        **{f"stop/{verb}": DONE for verb in STOPS},
        **{f"cmd/{verb}": DONE for verb in COMMANDS},
        **{f"cmd/{verb}": FORBIDDEN for verb in MAINTENANCE},
    },
    "carol": {  # maintainer
        **{f"ask/{verb}": DONE for verb in ASKS},
        **{f"stop/{verb}": DONE for verb in STOPS},
        **{f"cmd/{verb}": DONE for verb in (*COMMANDS, *MAINTENANCE)},
    },
    "mallory": {  # a good certificate, but no role
        **{f"ask/{verb}": SILENCE for verb in ASKS},
        **{f"stop/{verb}": SILENCE for verb in STOPS},
        **{f"cmd/{verb}": SILENCE for verb in (*COMMANDS, *MAINTENANCE)},
    },
}
ROWS = [(name, *what.split("/"), end) for name, row in TABLE.items() for what, end in row.items()]


@pytest.fixture(scope="module")
def clients(over_tls: Served) -> Iterator[Mapping[str, ZenohClient]]:
    opened = {name: over_tls.client(name) for name in TABLE}
    yield opened
    for client in opened.values():
        client.kill()


def holder_for(name: str, verb: str) -> str:
    """The identity that must hold the lease, so that nothing but the role decides."""
    return {"lease_request": "another", "lease_seize": "another"}.get(verb, name)


@pytest.mark.parametrize(("name", "kind", "verb", "end"), ROWS)
def test_each_role_may_use_only_its_verbs(
    over_tls: Served,
    clients: Mapping[str, ZenohClient],
    name: str,
    kind: str,
    verb: str,
    end: str,
) -> None:
    over_tls.rig.hold_lease(holder_for(name, verb))
    before = len(over_tls.rig.requests)
    replies = clients[name].get(key(kind, name, verb), request(verb))
    after = over_tls.rig.requests[before:]
    if end is SILENCE:
        assert replies == []
        assert after == []
        return
    assert len(replies) == 1
    reply = json.loads(replies[0]["payload"])
    if end is FORBIDDEN:
        assert reply["error"]["code"] == "forbidden"
        assert after == []
    else:
        assert [(item.requester.identity, item.verb.name) for item in after] == [(name, verb)]


def test_access_table_has_every_verb() -> None:
    known = {f"{kind.value}/{verb}" for kind, verbs in VERBS.items() for verb in verbs}
    for row in TABLE.values():
        assert set(row) == known


@pytest.mark.parametrize("verb", NEED_LEASE)
def test_command_without_lease_is_refused(
    over_tls: Served, clients: Mapping[str, ZenohClient], verb: str
) -> None:
    over_tls.rig.hold_lease("another")
    before = list(over_tls.rig.done)
    reply = clients["carol"].ask(key("cmd", "carol", verb), request(verb))
    assert reply["error"]["code"] == "no_lease"
    assert over_tls.rig.done == before


def test_only_the_holder_gives_the_lease(
    over_tls: Served, clients: Mapping[str, ZenohClient]
) -> None:
    over_tls.rig.hold_lease("another")
    reply = clients["carol"].ask(key("cmd", "carol", "lease_give"), request("lease_give"))
    assert reply["error"]["code"] == "no_lease"
    assert over_tls.rig.lease.view().is_held_by("another")
