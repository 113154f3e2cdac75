"""Reads a line of the wire format `poses-1`: one frame of a camera, in JSON (docs/devices.md)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

FORMAT: Final = "poses-1"
UNITS: Final = ["m", "rad"]
#: The numbers of a pose.
POSE: Final = ("x", "y", "heading")
#: Largest number of a frame, which a float of 64 bits still has exactly.
LARGEST_FRAME: Final = 2**53
#: Times beyond this are of no clock, in s: 3,000 years.
LARGEST_TIME_S: Final = 1e11


class Unreadable(Exception):
    """A line is not as the format has it.

    Attributes:
        kind: what is wrong, in words that are counted.
        detail: the same of this line.
    """

    def __init__(self, kind: str, detail: str) -> None:
        super().__init__(f"{kind}: {detail}")
        self.kind = kind
        self.detail = detail


@dataclass(frozen=True)
class Pose:
    """Where a body is, in m and rad; ``quality`` is 0 to 1."""

    x: float
    y: float
    heading: float
    quality: float = 1.0


@dataclass(frozen=True)
class Frame:
    """One frame: its number, when it was exposed by the camera's clock in ns, and its bodies.

    A body that was looked for and not found is None.
    """

    number: int
    camera_ns: int
    bodies: Mapping[str, Pose | None]


def read_frame(line: bytes) -> Frame:
    """Return the frame in ``line``.

    Raises:
        Unreadable: it is not as the format has it.

    """
    try:
        found = json.loads(line, parse_constant=_no_number)
    except (ValueError, RecursionError) as error:  # bytes that are no UTF-8 are a ValueError too
        raise Unreadable("not JSON", f"{error} in {line[:40]!r}") from error
    if not isinstance(found, dict):
        raise Unreadable("not an object", repr(line[:40]))
    for key, value in (("format", FORMAT), ("units", UNITS)):
        if _field(found, key, "the line") != value:
            kind = "another format" if key == "format" else "another unit"
            given = json.dumps(found[key])[:40]
            raise Unreadable(kind, f"{key} is {given}, expected {json.dumps(value)}")
    number = _field(found, "frame", "the line")
    if not isinstance(number, int) or isinstance(number, bool) or not 0 <= number <= LARGEST_FRAME:
        raise Unreadable("no frame number", f"frame is {json.dumps(number)[:40]}")
    time_s = _number(found, "time", "the line")
    if abs(time_s) > LARGEST_TIME_S:
        raise Unreadable("no time", f"time is {time_s:g} s")
    bodies = _field(found, "bodies", "the line")
    if not isinstance(bodies, dict):
        raise Unreadable("no bodies", f"bodies is {json.dumps(bodies)[:40]}")
    poses = {name: _pose(name, body) for name, body in bodies.items()}
    return Frame(number, round(time_s * 1e9), poses)


def _pose(name: str, body: Any) -> Pose | None:
    if body is None:
        return None
    if not isinstance(body, dict):
        raise Unreadable("not an object", f"body {name[:40]!r} is {json.dumps(body)[:40]}")
    of = f"body {name[:40]!r}"
    x, y, heading = (_number(body, key, of) for key in POSE)
    if abs(heading) > 2 * math.pi:
        raise Unreadable("another unit", f"heading of {of} is {heading:g} rad: is it in degrees?")
    quality = _number(body, "quality", of) if "quality" in body else 1.0
    if not 0.0 <= quality <= 1.0:
        raise Unreadable("no quality", f"quality of {of} is {quality:g}, expected 0 to 1")
    return Pose(x, y, math.remainder(heading, 2 * math.pi), quality)


def _field(found: Mapping[str, Any], key: str, where: str) -> Any:
    if key not in found:
        raise Unreadable("a field is missing", f"{where} has no {key!r}")
    return found[key]


def _number(found: Mapping[str, Any], key: str, where: str) -> float:
    value = _field(found, key, where)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise Unreadable("not a number", f"{key} of {where} is {json.dumps(value)[:40]}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise Unreadable("not a number", f"{key} of {where} is not finite")
    return number


def _no_number(word: str) -> float:
    """Refuse NaN and Infinity, which Python's reader would take and JSON does not have."""
    raise Unreadable("not a number", f"{word}, which JSON does not have")
