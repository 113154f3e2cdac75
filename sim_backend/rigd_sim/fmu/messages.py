"""What passes between a plant and the process of its FMU."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

#: First byte of a request for steps; all others are JSON.
STEP: Final = b"s"
#: STEP, index of the first step, number of steps; the inputs follow, a double each.
REQUEST: Final = struct.Struct("<cqq")
#: First byte of an answer. After that to a request for steps, doubles: the seconds that they took
#: and the outputs; after FAILED the text of what failed.
OK: Final = b"+"
FAILED: Final = b"-"
#: Largest message in bytes.
LARGEST: Final = 150_000


@dataclass(frozen=True)
class Setup:
    """What an FMU is made from; ``start`` has name, type, reference and value of each.

    ``logging`` asks the FMU for all that it can report, which may take time in each step.
    ``priority`` is that of SCHED_FIFO at which it takes its steps, 0 for an ordinary program.
    """

    path: str
    sha256: str
    version: str
    folder: str
    step_ns: int
    logging: bool
    priority: int
    start: list[tuple[str, str, int, float | int | bool | str]]


@dataclass(frozen=True)
class Wires:
    """Type and value reference of each variable that steps set, and of each that they return."""

    inputs: list[tuple[str, int]]
    outputs: list[tuple[str, int]]
