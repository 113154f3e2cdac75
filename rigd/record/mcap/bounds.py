"""Bounds what rigd unpacks of a recording: a small file may claim, or be, any number of bytes.

rigd writes chunks of 1 MiB, other programs mostly of 1 to 16 MiB. Who trusts a file of larger ones
names the bound in an environment variable, which every command and every process then has.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Self

from rigd.model import ConfigError, RecordingError

#: Environment variable that names the most MiB of one chunk, unpacked.
CHUNK_VARIABLE: Final = "RIGD_CHUNK_MIB"
CHUNK_MIB: Final = 64
#: All chunks of a file may have as many bytes as 16 of the largest ones, or 1,000 times those of
#: the file: rows of 256 channels that never change are compressed to a 245th.
_CHUNKS: Final = 16
_TIMES: Final = 1000
#: All chunks may have as many records as one of the largest has (a message has 31 bytes or more),
#: or as the file has bytes: a message is seldom compressed to less than one, and rigd keeps 40
#: bytes of each while it reads a file of others.
_RECORD_BYTES: Final = 32
#: The texts of events may have a quarter of the largest chunk, or 50 times the bytes of the file:
#: Python makes objects of up to 20 times their bytes, and real ones are compressed to a tenth.
_EVENTS: Final = 4
_EVENT_TIMES: Final = 50


class TooLarge(RecordingError):
    """A recording claims more bytes than rigd unpacks unless it is asked to."""

    def of(self, path: Path) -> Self:
        """Return the error with the file that it is about."""
        return type(self)(f"{path} cannot be read: {self.message}", hint=self.hint)


@dataclass
class _Budget:
    """How many bytes may still be unpacked, and how many records may be in them."""

    left: int
    records: int


_budget: ContextVar[_Budget | None] = ContextVar("budget", default=None)


@contextmanager
def budget(file_bytes: int) -> Iterator[None]:
    """Bound all that is unpacked inside of the block, by the size of the file."""
    records = max(largest_chunk() // _RECORD_BYTES, file_bytes)
    token = _budget.set(_Budget(most(file_bytes), records))
    try:
        yield
    finally:
        _budget.reset(token)


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Name the file in a :class:`TooLarge` that is raised inside of the block."""
    try:
        yield
    except TooLarge as error:
        raise error.of(path) from error


def permit(size: int) -> None:
    """Raise unless a chunk of ``size`` bytes may be unpacked.

    Raises:
        TooLarge: it is larger than the bound, or with it more than all chunks may have.
    """
    largest = largest_chunk()
    if size > largest:
        raise TooLarge(
            f"a chunk of {size} bytes is more than the {largest >> 20} MiB that rigd unpacks",
            hint=_how_to_permit(-(-size >> 20)),
        )
    held = _budget.get()
    if held is not None:
        held.left -= size
        if held.left < 0:
            raise _too_many("chunks", _TIMES)


def permit_records(count: int) -> None:
    """Raise unless a chunk may have so many records.

    Raises:
        TooLarge: with it, the chunks have more records than the file has bytes.
    """
    held = _budget.get()
    if held is not None:
        held.records -= count
        if held.records < 0:
            raise TooLarge(
                "its chunks have more records than the file has bytes",
                hint=_how_to_permit(2 * largest_chunk() >> 20),
            )


def require_sum(sizes: int, file_bytes: int) -> None:
    """Raise unless chunks of ``sizes`` bytes in all may be unpacked.

    Raises:
        TooLarge: they are too many for the size of the file.
    """
    if sizes > most(file_bytes):
        raise _too_many("chunks", _TIMES)


def require_events(text_bytes: int, file_bytes: int) -> None:
    """Raise unless events of so many bytes in all may be read.

    Raises:
        TooLarge: they are too many for the size of the file.
    """
    if text_bytes > max(largest_chunk() // _EVENTS, _EVENT_TIMES * file_bytes):
        raise _too_many("events", _EVENT_TIMES)


def most(file_bytes: int) -> int:
    """Return how many bytes all chunks of a file may have."""
    return max(_CHUNKS * largest_chunk(), _TIMES * file_bytes)


def largest_chunk() -> int:
    """Return the most bytes of one chunk.

    Raises:
        ConfigError: the environment names none.
    """
    text = os.environ.get(CHUNK_VARIABLE, "")
    if not text:
        return CHUNK_MIB << 20
    if not text.isdecimal() or not int(text):
        raise ConfigError(
            f"{CHUNK_VARIABLE}={text} is no number of MiB",
            hint=f"{CHUNK_VARIABLE}={CHUNK_MIB} is what rigd takes by itself.",
        )
    return int(text) << 20


def _too_many(what: str, times: int) -> TooLarge:
    return TooLarge(
        f"its {what} have more than {times} times the bytes of the file",
        hint=_how_to_permit(2 * largest_chunk() >> 20),
    )


def _how_to_permit(mib: int) -> str:
    return (
        f"If you trust the file and there is memory for it, set {CHUNK_VARIABLE}={mib} in the "
        "environment, the most MiB of a chunk that rigd unpacks."
    )
