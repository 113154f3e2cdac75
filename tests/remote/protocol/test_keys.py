"""Keys: any identity fits, and nothing else does."""

from __future__ import annotations

import pytest
import zenoh

from rigd.remote.protocol import EVERY_ALIVE, Code, Keys, Kind, Refusal
from rigd.remote.protocol.keys import MAX_KEY

KEYS = Keys("lugre-1")


def test_keys_of_a_rig_are_as_documented() -> None:
    assert KEYS.alive == "rigd/lugre-1/alive"
    assert KEYS.status == "rigd/lugre-1/status"
    assert KEYS.event == "rigd/lugre-1/event"
    assert KEYS.live("wheel") == "rigd/lugre-1/live/wheel"
    assert KEYS.request(Kind.ASK, "bob", "runs") == "rigd/lugre-1/ask/bob/runs"
    assert KEYS.request(Kind.COMMAND, "bob", "start") == "rigd/lugre-1/cmd/bob/start"
    assert KEYS.request(Kind.STOP, "bob", "estop") == "rigd/lugre-1/stop/bob/estop"


def test_zenoh_accepts_every_key_unchanged() -> None:
    keys = [
        KEYS.alive, KEYS.status, KEYS.event, KEYS.live("wheel"), KEYS.every_live, EVERY_ALIVE,
        *(KEYS.every_request(kind) for kind in Kind),
        *(KEYS.request(kind, "A.b_c-1", "verb") for kind in Kind),
    ]  # fmt: skip
    assert [str(zenoh.KeyExpr.autocanonize(key)) for key in keys] == keys


@pytest.mark.parametrize("kind", Kind)
def test_key_contains_identity_and_verb(kind: Kind) -> None:
    address = KEYS.address(KEYS.request(kind, "bob", "verb"))
    assert (address.kind, address.identity, address.verb) == (kind, "bob", "verb")


@pytest.mark.parametrize(
    "name", ["", "a/b", "*", "**", "a b", "$*", "é", "a" * 65, "a\n", "#", "?"]
)
def test_special_characters_of_zenoh_are_refused(name: str) -> None:
    for make in (
        lambda: Keys(name),
        lambda: KEYS.live(name),
        lambda: KEYS.request(Kind.ASK, name, "runs"),
        lambda: KEYS.request(Kind.ASK, "bob", name),
        lambda: KEYS.address(f"rigd/lugre-1/cmd/{name}/start"),
    ):
        with pytest.raises(Refusal) as caught:
            make()
        assert caught.value.code is Code.BAD_REQUEST


@pytest.mark.parametrize(
    "key",
    [
        "rigd/other/cmd/bob/start",
        "rigd/lugre-1/cmd/bob",
        "rigd/lugre-1/cmd/bob/start/now",
        "rigd/lugre-1/live/bob/start",
        "rigd/lugre-1/status",
        "x" * 100_000,
        "/" * 100_000,
    ],
)
def test_the_key_of_no_request_is_refused(key: str) -> None:
    with pytest.raises(Refusal):
        KEYS.address(key)


def test_the_longest_names_make_the_longest_key() -> None:
    keys = Keys("r" * 64)
    assert len(keys.request(Kind.STOP, "i" * 64, "v" * 64)) == MAX_KEY
