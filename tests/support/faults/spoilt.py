"""Payloads that no client of ours sends: random bytes, and good messages spoilt in one place.

None of them is a good message by chance: what is spoilt is a key, the version, the id, or the
length.
"""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from typing import Any

#: Values of an unexpected type.
_ODD: tuple[Any, ...] = (
    None, [], {}, "", "x" * 5000, -1, 2**63, 2**70, 1e308, {"a": {"a": {"a": []}}}, ["v"], "\x00",
)  # fmt: skip


def spoilt_payloads(rng: random.Random, good: bytes, count: int) -> Iterator[bytes]:
    """Yield ``count`` payloads, each spoilt in another way."""
    ways = (_noise, _cut, _flipped, _odd_value, _extra_key, _missing_key, _deep, _wrong_args)
    for number in range(count):
        yield ways[number % len(ways)](rng, good)


def _noise(rng: random.Random, good: bytes) -> bytes:
    return rng.randbytes(rng.choice((0, 1, 10, 1000, 66_000)))


def _cut(rng: random.Random, good: bytes) -> bytes:
    return good[: rng.randrange(len(good))]


def _flipped(rng: random.Random, good: bytes) -> bytes:
    """Bytes changed to ones that cannot stand in JSON outside of text, nor in UTF-8 inside."""
    spoilt = bytearray(good)
    for _ in range(rng.randrange(1, 10)):
        spoilt[rng.randrange(len(spoilt))] = rng.choice((0xFF, 0xC0, 0x80, 0x00))
    return bytes(spoilt)


def _odd_value(rng: random.Random, good: bytes) -> bytes:
    message = json.loads(good)
    message[rng.choice(("v", "id", "sent_ns"))] = rng.choice(_ODD)
    return json.dumps(message).encode()


def _extra_key(rng: random.Random, good: bytes) -> bytes:
    message = json.loads(good)
    where = message if rng.random() < 0.5 else message["args"]
    where[rng.choice(("", "__class__", "role", "identity", "lease", "x" * 1000))] = rng.choice(_ODD)
    return json.dumps(message).encode()


def _missing_key(rng: random.Random, good: bytes) -> bytes:
    message = json.loads(good)
    del message[rng.choice(list(message))]
    return json.dumps(message).encode()


def _deep(rng: random.Random, good: bytes) -> bytes:
    depth = rng.choice((17, 100, 2000, 20_000))
    message = json.loads(good) | {"args": 0}
    left, right = rng.choice((("[", "]"), ('{"a":', "}")))
    depth = min(depth, 60_000 // len(left + right))
    return json.dumps(message).replace(": 0}", f": {left * depth}1{right * depth}}}").encode()


def _wrong_args(rng: random.Random, good: bytes) -> bytes:
    return json.dumps(json.loads(good) | {"args": rng.choice(_ODD[:2] + _ODD[3:])}).encode()
