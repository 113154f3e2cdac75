"""Has the names of the protocol that other packages use: its package imports them from here."""

from rigd.remote.protocol.frame import Frame, decode_frame, encode_frame
from rigd.remote.protocol.keys import EVERY_ALIVE, Address, Keys, Kind, check_name
from rigd.remote.protocol.limits import VERSION
from rigd.remote.protocol.message import Message, decode, encode
from rigd.remote.protocol.refusal import Code, Refusal
from rigd.remote.protocol.request import (
    RemoteRequest,
    Reply,
    decode_refusal,
    encode_refusal,
    encode_reply,
    encode_request,
    new_request,
    request_kind,
)
from rigd.remote.protocol.roles import Role
from rigd.remote.protocol.status import ClientUser, LeaseView, RigEvent, Status, as_json
from rigd.remote.protocol.verbs import (
    PATIENCE_S,
    VERBS,
    Handlers,
    Lane,
    Requester,
    Verb,
    check_role,
    find_verb,
)

__all__ = [
    "EVERY_ALIVE",
    "PATIENCE_S",
    "VERBS",
    "VERSION",
    "Address",
    "ClientUser",
    "Code",
    "Frame",
    "Handlers",
    "Keys",
    "Kind",
    "Lane",
    "LeaseView",
    "Message",
    "Refusal",
    "RemoteRequest",
    "Reply",
    "Requester",
    "RigEvent",
    "Role",
    "Status",
    "Verb",
    "as_json",
    "check_name",
    "check_role",
    "decode",
    "decode_frame",
    "decode_refusal",
    "encode",
    "encode_frame",
    "encode_refusal",
    "encode_reply",
    "encode_request",
    "find_verb",
    "new_request",
    "request_kind",
]
