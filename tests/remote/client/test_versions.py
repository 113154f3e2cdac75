"""A client before a daemon of another version: only a stop is accepted."""

from __future__ import annotations

import json
from collections.abc import Iterator

import pytest
import zenoh
from support.daemon.served_rig import free_port

from rigd.model.errors import ProtocolError
from rigd.remote import Client
from rigd.remote.protocol import Code, Refusal, encode_refusal

STATUS = {"v": 2, "rig": "lugre-1", "mood": "fine"}


@pytest.fixture
def endpoint() -> Iterator[str]:
    """Address of a daemon of version 2."""
    at = f"tcp/127.0.0.1:{free_port()}"
    settings = zenoh.Config.from_json5(
        json.dumps({"mode": "peer", "listen": {"endpoints": [at]},
                    "scouting": {"multicast": {"enabled": False}}})
    )  # fmt: skip
    refused = Refusal(Code.VERSION, "stop: carried out; here it is 2")

    def tell(query: zenoh.Query) -> None:
        query.reply(query.key_expr, json.dumps(STATUS).encode())

    def stop(query: zenoh.Query) -> None:
        if str(query.key_expr).endswith("/abort"):  # as a newer daemon before the first release
            request = json.loads(bytes(query.payload or b"{}"))
            reply = {"v": 1, "id": request["id"], "result": {"acted": True, "added": 1}}
            query.reply(query.key_expr, json.dumps(reply).encode())
            return
        query.reply_err(encode_refusal("", refused))

    with zenoh.open(settings) as session:
        session.declare_queryable("rigd/lugre-1/status", tell)
        session.declare_queryable("rigd/lugre-1/stop/*/*", stop)
        yield at


def test_rig_of_another_version_can_only_be_stopped(endpoint: str) -> None:
    with Client("lugre-1", endpoint=endpoint, identity="eve") as rig:
        with pytest.raises(Refusal, match="stop: carried out; here it is 2"):
            rig.stop()
        with pytest.raises(ProtocolError, match="version 2 of the protocol, here it is 1"):
            rig.status()


def test_reply_with_unknown_key_names_key_and_remedy(endpoint: str) -> None:
    with Client("lugre-1", endpoint=endpoint, identity="eve") as rig:
        with pytest.raises(ProtocolError, match=r"result\.added: .*not permitted") as caught:
            rig.abort()
        assert caught.value.hint == "install the same rigd at both ends"
