"""Defines the base class of all messages, and encodes and decodes messages as strict JSON.

Messages are frozen models. A valid message has these properties:

- It has the JSON keys that its model names, no unknown key, and no key twice.
- Every value has exactly its type and is finite.
- It is nested no deeper than ``MAX_DEPTH`` and is no larger than its limit.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal, TypeVar

from pydantic import BeforeValidator, ConfigDict, JsonValue, StringConstraints, ValidationError

from rigd.remote.protocol.limits import (
    MAX_DEPTH,
    MAX_MESSAGE_BYTES,
    MAX_NAME,
    MAX_REQUEST_BYTES,
    MAX_TEXT,
    MAX_USER,
    VERSION,
)
from rigd.remote.protocol.refusal import Code, Refusal
from rigd.remote.protocol.stop import one_line
from rigd.sdk import Documented

#: A part of a key: no character with a special meaning for zenoh, a shell or a path.
Name = Annotated[str, StringConstraints(pattern=rf"^[A-Za-z0-9._-]{{1,{MAX_NAME}}}$")]
#: A text for a person, of one or several lines.
Text = Annotated[str, StringConstraints(max_length=MAX_TEXT)]
#: Such a text from the daemon: cut to its limit, without characters that UTF-8 cannot encode or
#: that control a terminal, and without the folders of paths. It may come from any file.
DaemonText = Annotated[
    Text, BeforeValidator(lambda text: _printable(text) if isinstance(text, str) else text)
]
#: The name of a client's user, in one line.
User = Annotated[
    str,
    BeforeValidator(lambda text: one_line(text) if isinstance(text, str) else text),
    StringConstraints(max_length=MAX_USER),
]
#: The version that a message of its own carries.
Version = Literal[1]

#: Control characters (Unicode's category Cc), which control a terminal, but tab and line feed.
_STEERING: Final = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
#: The folders of an absolute path, but not of a device or an address such as ``tcp/1.2.3.4:1``.
_FOLDERS: Final = re.compile(
    r"(?<![\w/.:~-])~?/(?!(?:dev|proc|sys)/)(?:[^\s/:;,'\"()]+/)+(?=[^\s/])"
)
#: Characters of the problems of a message in the refusal.
_MAX_PROBLEMS: Final = 300
#: Versions are numbers below this; a message with a larger one is damaged.
_NO_VERSION: Final = 2**16


class Message(Documented):
    """A message or a part of one."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)


M = TypeVar("M", bound=Message)


def encode(message: Message, limit_bytes: int = MAX_MESSAGE_BYTES) -> bytes:
    """Return ``message`` as JSON.

    Raises:
        Refusal: it is larger than ``limit_bytes``.
    """
    payload = message.model_dump_json().encode()
    check_size(payload, limit_bytes)
    return payload


def decode(kind: type[M], payload: bytes, limit_bytes: int = MAX_REQUEST_BYTES) -> M:
    """Return ``payload`` as a message of ``kind``.

    Raises:
        Refusal: too large, not strict JSON, of another version, or not of this kind.
    """
    check_size(payload, limit_bytes)
    _check_json(payload)
    try:
        return kind.model_validate_json(payload)
    except ValidationError as error:
        raise _refusal(error) from error


def check_size(payload: bytes, limit_bytes: int) -> None:
    """Check that a message has at most ``limit_bytes``.

    Raises:
        Refusal: it has more.
    """
    if len(payload) > limit_bytes:
        raise Refusal(
            Code.TOO_LARGE, f"the message has {len(payload)} bytes, at most {limit_bytes} may be"
        )


def _printable(text: str) -> str:
    return _STEERING.sub("?", without_folders(text)[:MAX_TEXT]).encode(errors="replace").decode()


def without_folders(value: Any) -> Any:
    """Return JSON data whose texts name files of the daemon's computer without their folders.

    Observers need not know these. Devices (``/dev/ttyUSB0``) keep their paths.
    """
    if isinstance(value, str):
        return _FOLDERS.sub("", value) if "/" in value else value
    if isinstance(value, Mapping):
        return {key: without_folders(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_folders(item) for item in value]
    return value


#: JSON data from the daemon; see :func:`without_folders`.
DaemonData = Annotated[dict[str, JsonValue], BeforeValidator(without_folders)]


def _check_json(payload: bytes) -> None:
    """Refuse JSON that a lenient parser accepts: a repeated key, NaN, infinities, deep nesting."""
    try:
        data = json.loads(
            payload.decode(),  # from bytes, json would accept UTF-16 and UTF-32 too
            object_pairs_hook=_without_repeats,
            parse_constant=_finite,
            parse_float=_finite,
        )
    except RecursionError as error:
        raise _too_deep() from error
    except ValueError as error:
        raise Refusal(Code.BAD_REQUEST, f"not JSON: {str(error)[:_MAX_PROBLEMS]}") from error
    level = [data]
    for _ in range(MAX_DEPTH):
        level = [
            inner
            for outer in level
            if isinstance(outer, dict | list)
            for inner in (outer.values() if isinstance(outer, dict) else outer)
        ]
    if any(isinstance(item, dict | list) for item in level):
        raise _too_deep()


def _too_deep() -> Refusal:
    return Refusal(Code.BAD_REQUEST, f"nested deeper than {MAX_DEPTH} levels")


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError("a key appears twice in one object")
    return found


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]} is not a finite number")
    return value


def _refusal(error: ValidationError) -> Refusal:
    found = error.errors(include_url=False, include_context=False)
    for item in found:
        version = item["input"]
        if item["loc"] == ("v",) and type(version) is int and 0 < version < _NO_VERSION:
            return Refusal(
                Code.VERSION,
                f"the message is of version {version} of the protocol, here it is {VERSION}",
                hint="install the same rigd at both ends",
            )
    text = "; ".join(f"{'.'.join(map(str, item['loc']))}: {item['msg']}" for item in found[:3])
    return Refusal(Code.BAD_REQUEST, text[:_MAX_PROBLEMS])
