"""Well-formed requests with random content: refused with a reason, and nothing has changed."""

from __future__ import annotations

import json
import random
from pathlib import Path
from typing import Any

from support.daemon.served_axis import SWEEP, ServedAxis, travelling
from support.daemon.served_rig import request

from rigd.config.remote import RemoteSetup
from rigd.remote.protocol import VERBS, ClientUser, Code, Keys, Kind, Lane, Verb
from rigd.remote.server.dispatcher import Dispatcher
from rigd.remote.server.refusal_log import Refused

#: What some argument may be, and another must not.
_ODD: tuple[Any, ...] = (
    "", " ", ".", "..", "../x.mcap", "x" * 200, "x" * 4000, "\x00", "\n", "\u202e", "NaN", "-1",
    "1e308 m", "${x}", "[", "*a", "!!a", "none", "axis", "axis.speed", "sweep", "tare", "cycle",
    "audit.jsonl", "nowhere.mcap", "empty.mcap", "folder.mcap", "1 µm", "A/0", "m^9", "%s",
    -1, 0, 1, 2**31, 2**53, 2**63 - 1, 2**63, 2**70, 0.5, 1e308, True, None, {}, [],
    {"speed": "0.1 m/s"}, {"time": "-1 s"}, {"time": "1e300 s", "speed": ""},
)  # fmt: skip


def spoilt(rng: random.Random) -> str:
    """The text of a procedure with some words replaced."""
    words = SWEEP.split(" ")
    for _ in range(rng.randrange(1, 4)):
        words[rng.randrange(len(words))] = str(rng.choice(_ODD))
    return " ".join(words)


def wild(rng: random.Random, verb: Verb) -> dict[str, Any]:
    """Arguments of the right types, as far as they are found by chance."""
    args: dict[str, Any] = {}
    for _ in range(100):
        fields = verb.arguments.model_fields
        args = {name: rng.choice(_ODD) for name in fields if rng.random() < 0.5}
        if "procedure" in fields:
            args["procedure"] = {**travelling(spoilt(rng)), "name": "sweep"}
        try:
            verb.arguments.model_validate_json(json.dumps(args))
        except ValueError:
            continue
        break
    return args


def test_random_arguments_change_nothing(tmp_path: Path) -> None:
    rng = random.Random(6)
    with ServedAxis(tmp_path) as served:
        (served.runs / "empty.mcap").touch()
        (served.runs / "folder.mcap").mkdir()
        (served.runs / "nowhere.mcap").symlink_to(tmp_path / "unmounted")
        keys = Keys(served.rig.name)
        setup = RemoteSetup(("tcp/127.0.0.1:1",), roles={"eve": "maintainer"})
        dispatcher = Dispatcher(keys, setup, served.service, served.lease, Refused())
        served.command("lease_take", "eve")
        before, files = served.status, sorted(served.runs.iterdir())
        codes = set()
        for kind, verbs in VERBS.items():
            for name, verb in verbs.items():
                if name.startswith("lease_") or verb.rule.lane in (Lane.LONG, Lane.COMPARE):
                    continue
                for _ in range(12 if verb.arguments.model_fields else 1):
                    payload = request(name, args=wild(rng, verb))
                    answer = dispatcher.answer(
                        dispatcher.sort(keys.request(kind, "eve", name), payload)
                    )
                    said = json.loads(answer.payload)
                    assert answer.ok or said["error"]["code"] != Code.INTERNAL.value, said
                    codes.add("done" if answer.ok else said["error"]["code"])
                    assert not (answer.ok and kind is Kind.COMMAND), said
        after = served.status
        assert (after.state, after.lease.holder, after.trips, after.last) == (
            "idle", ClientUser.of("eve"), before.trips, before.last,
        )  # fmt: skip
        assert set(served.runs.iterdir()) - set(files) <= {served.audit.path}
    assert {"done", "not_found", "bad_request", "refused", "conflict"} <= codes
