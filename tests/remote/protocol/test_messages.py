"""Messages are read as strictly as they are written."""

from __future__ import annotations

import json
from typing import Any, get_args

import pytest
from pydantic import ValidationError

from rigd.model.states import RunState
from rigd.remote.protocol import (
    VERSION,
    Code,
    Refusal,
    RemoteRequest,
    RigEvent,
    Status,
    decode,
    decode_refusal,
    encode,
    encode_refusal,
    encode_reply,
    encode_request,
    new_request,
)
from rigd.remote.protocol.arguments import (
    Answered,
    PieceArguments,
    ProcedureFile,
    ReasonArguments,
    RunArguments,
    StartArguments,
)
from rigd.remote.protocol.limits import MAX_DEPTH, MAX_REQUEST_BYTES, MAX_TEXT
from rigd.remote.protocol.request import Error, Reply
from rigd.remote.protocol.results import PieceView
from rigd.remote.protocol.status import Daemon, PromptView, State, TrialStatus
from rigd.remote.protocol.stop import PlainStop, stop_reason

START = StartArguments(procedure=ProcedureFile.of("one", "procedure: one"))


def request_bytes(**changes: Any) -> bytes:
    """A request for `start`, with some of its keys replaced."""
    data = json.loads(encode_request(new_request(START)))
    return json.dumps(data | changes).encode()


def refused(payload: bytes) -> Refusal:
    with pytest.raises(Refusal) as caught:
        decode(RemoteRequest[StartArguments], payload)
    return caught.value


def test_encoded_request_decodes_unchanged() -> None:
    request = new_request(START)
    assert decode(RemoteRequest[StartArguments], encode_request(request)) == request


def test_no_two_requests_have_the_same_id() -> None:
    assert len({new_request(START).id for _ in range(100)}) == 100


@pytest.mark.parametrize("reason", ["", "smoke", "über\n\x1b[2J", "x" * 400, "\ud800"])
def test_stop_without_models_decodes_as_request(reason: str) -> None:
    stop = PlainStop(reason)
    read = decode(RemoteRequest[ReasonArguments], stop.encode())
    assert (read.id, read.sent_ns, read.user) == (stop.id, stop.sent_ns, "")
    assert read.args.reason == stop_reason(reason)


def test_stop_reads_only_the_reply_to_itself() -> None:
    stop = PlainStop()
    assert stop.read_reply(encode_reply(stop.id, {"acted": True})) is True
    assert stop.read_reply(encode_reply(stop.id, {"acted": False})) is False
    other = encode_reply(PlainStop().id, {"acted": True})
    unsaid = encode_reply(stop.id, {"acted": "yes"})
    for payload in (other, unsaid, b"", b"\xff", b"[]", b'{"v": 1}', b"[" * 100_000):
        assert stop.read_reply(payload) is None


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"{",
        b"null",
        b"[]",
        b"\xff\xfe{\x00}\x00",
        '{"v": 1}'.encode("utf-16"),
        b'{"v": 1, "v": 1}',
        request_bytes(extra=1),
        request_bytes(id="0" * 31),
        request_bytes(id="A" * 32),
        request_bytes(id="0" * 32 + "\n"),
        request_bytes(sent_ns=-1),
        request_bytes(sent_ns=2**63),
        request_bytes(sent_ns=1.0),
        request_bytes(sent_ns="1"),
        request_bytes(sent_ns=True),
        request_bytes(args={}),
        request_bytes(args=[]),
        request_bytes().replace(b'"seed": null', b'"seed": NaN'),
        request_bytes().replace(b'"seed": null', b'"seed": 1e999'),
        request_bytes().replace(b'"seed": null', b'"seed": ' + b"9" * 5000),
        request_bytes().replace(b'"set": {}', b'"set": {"../x": "1"}'),
        request_bytes().replace(b'"set": {}', b'"set": {"a": 1}'),
        request_bytes().replace(b'"set": {}', b'"set": {"a": "\\ud800"}'),
    ],
    ids=lambda payload: f"{len(payload)} bytes",
)
def test_payload_that_is_no_request_is_refused(payload: bytes) -> None:
    assert refused(payload).code is Code.BAD_REQUEST


def test_later_version_is_distinguished_from_nonsense() -> None:
    found = refused(request_bytes(v=2, new="key"))
    assert found.code is Code.VERSION
    assert "version 2 of the protocol, here it is 1" in found.message


def test_refusal_of_another_version_is_understood() -> None:
    sent = json.loads(encode_refusal("0" * 32, Refusal(Code.VERSION, "here it is 2")))
    got = decode_refusal(json.dumps(sent | {"v": 2}).encode())
    assert (got.code, got.message) == (Code.VERSION, "here it is 2")


def test_missing_version_is_refused() -> None:
    data = json.loads(request_bytes())
    del data["v"]
    assert refused(json.dumps(data).encode()).code is Code.BAD_REQUEST


def test_request_too_large_is_refused_on_both_sides() -> None:
    large = START.model_copy(
        update={"procedure": START.procedure.model_copy(update={"text": "x" * MAX_REQUEST_BYTES})}
    )
    with pytest.raises(Refusal, match="at most 65536"):
        encode_request(new_request(large))
    assert refused(b" " * (MAX_REQUEST_BYTES + 1)).code is Code.TOO_LARGE


@pytest.mark.parametrize("depth", [MAX_DEPTH + 1, 1000, 30_000])
@pytest.mark.parametrize(("left", "right"), [("[", "]"), ('{"a":', "}")])
def test_deep_nesting_is_refused(depth: int, left: str, right: str) -> None:
    depth = min(depth, MAX_REQUEST_BYTES // (len(left) + len(right)) - 10)
    payload = f"{left * depth}1{right * depth}".encode()
    assert "deep" in refused(payload).message
    unclosed = f"{left * depth}".encode()
    assert refused(unclosed).code is Code.BAD_REQUEST


def test_nesting_up_to_the_limit_passes() -> None:
    value: Any = 1
    for _ in range(MAX_DEPTH - 2):
        value = [value]
    assert decode(Reply, encode_reply("0" * 32, {"a": value})).result == {"a": value}


def test_error_of_bad_message_is_short() -> None:
    assert len(refused(request_bytes(**{"k" * 5000: 1})).message) <= 300


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "a/b.mcap", ".hidden", "", "a b", "x" * 201, "a\n"]
)
def test_a_recording_is_named_never_a_path(name: str) -> None:
    with pytest.raises(ValidationError):
        RunArguments(run=name)
    with pytest.raises(ValidationError):
        PieceArguments(run=name)


def test_procedure_differing_from_sent_text_is_refused() -> None:
    spoilt = encode_request(new_request(START)).replace(b"procedure: one", b"procedure: two")
    found = refused(spoilt)
    assert found.code is Code.BAD_REQUEST
    assert "the text of one has the SHA-256" in found.message


def test_an_answer_keeps_its_type() -> None:
    for value in (True, False, 1.5, "soft"):
        payload = encode_request(new_request(Answered(prompt_id=1, value=value)))
        got = decode(RemoteRequest[Answered], payload).args.value
        assert (got, type(got)) == (value, type(value))


def test_piece_of_file_is_sent_as_base64() -> None:
    piece = PieceView(size=3, sha256="0" * 64, offset=0, data=b"AP8K")
    assert piece.data == b"\x00\xff\n"
    assert b'"data":"AP8K"' in encode(piece)


def test_encoded_refusal_decodes_unchanged() -> None:
    refusal = Refusal(Code.NO_LEASE, "bob holds the lease", hint="ask bob")
    got = decode_refusal(encode_refusal("0" * 32, refusal))
    assert (got.code, got.message, got.hint) == (refusal.code, refusal.message, refusal.hint)


def test_refusal_of_unreadable_request_has_no_id() -> None:
    assert json.loads(encode_refusal("", Refusal(Code.BAD_REQUEST, "no")))["id"] == ""


def test_error_of_zenoh_is_a_refusal() -> None:
    assert decode_refusal(b"Timeout").code is Code.INTERNAL


def test_status_has_every_state_of_a_run() -> None:
    assert set(get_args(State)) == {state.name.lower() for state in RunState}


def test_a_status_survives_the_wire() -> None:
    status = Status(
        v=VERSION,
        rig="lugre-1",
        title="A rig",
        t_ns=1,
        rows_ns=1,
        seq=2,
        daemon=Daemon(version="0.1.0", pid=7, started_ns=0),
        state="running",
        trial=TrialStatus(
            number=1, repeat=1, parameters={"floor": "pvc", "current": 0.15, "up": True}
        ),
    )
    got = decode(Status, encode(status))
    assert got == status
    assert got.trial is not None
    assert got.trial.parameters["up"] is True


def test_file_text_of_any_length_can_be_sent() -> None:
    """The text of a prompt is its author's; a status that cannot be sent hides the rig."""
    prompt = PromptView(id=1, name="ready", text="\ud800" + "x" * 10_000, kind="confirm")
    assert decode(PromptView, encode(prompt)).text == "?" + "x" * (MAX_TEXT - 1)


def test_no_text_of_a_procedure_steers_a_terminal() -> None:
    prompt = PromptView(id=1, name="ready", text="µ \x1b[2J\x9b2J\r\n\tok", kind="confirm")
    assert prompt.text == "µ ?[2J?2J?\n\tok"


def test_event_refuses_values_without_json_form() -> None:
    with pytest.raises(ValidationError):
        RigEvent(v=VERSION, seq=1, t_ns=1, kind="trip", data={"value": float("nan")})


@pytest.mark.parametrize(
    ("said", "shown"),
    [
        ("/home/lab/runs/a.mcap is no file", "a.mcap is no file"),
        ("'/srv/rigs/rig.yaml:3:1: unknown'", "'rig.yaml:3:1: unknown'"),
        ("(see ~/rigs/rig.yaml)", "(see rig.yaml)"),
        ("folder=/a/b; next /c/d/e.html", "folder=b; next e.html"),
        ("no serial port at /dev/ttyUSB0", "no serial port at /dev/ttyUSB0"),
        ("tls/rig.lab:7447, http://rig.lab/a/b", "tls/rig.lab:7447, http://rig.lab/a/b"),
        ("1 m/s, and/or 3 / 4, /stop", "1 m/s, and/or 3 / 4, /stop"),
    ],
)
def test_texts_of_daemon_name_no_folders(said: str, shown: str) -> None:
    assert Error(code=Code.REFUSED, message=said).message == shown
    event = RigEvent(v=VERSION, seq=1, t_ns=1, kind="fault", data={"reason": [said], "n": 1})
    assert event.data == {"reason": [shown], "n": 1}
