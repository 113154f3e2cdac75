"""Bounds what a file of another program may claim, or unpack to: a small one may be of any size.

The bounds are those of recordings (:mod:`rigd.record.mcap.bounds`), and grow with the same
variable.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from rigd.model.errors import ConfigError, Place
from rigd.record.mcap.bounds import CHUNK_VARIABLE, largest_chunk, most

#: No table of a test has more; each costs memory and time before the first row is read.
MOST_COLUMNS: Final = 50_000
#: What is unpacked at once in order to count it, in bytes.
_PIECE: Final = 1 << 20
_VALUE_BYTES: Final = 8


def require_cells(path: Path, rows: int, columns: int) -> None:
    """Raise unless so many rows and columns may be read of a file.

    Raises:
        ConfigError: they have more bytes than rigd unpacks of all chunks of a recording.
    """
    if rows * columns * _VALUE_BYTES > most(path.stat().st_size):
        what = f"{rows} rows of {columns} columns, with more than 1000 times the bytes of the file"
        raise _too_large(path, what, _doubled())


def require_columns(path: Path, name: str, count: int) -> None:
    """Raise unless an array of a file may have so many columns.

    Raises:
        ConfigError: they are too many.
    """
    if count > MOST_COLUMNS:
        raise ConfigError(
            f"the array {name!r} has {count} columns, more than the {MOST_COLUMNS} that rigd reads",
            place=Place(str(path), 1, 1),
            hint="if its rows and columns are exchanged, save it transposed",
        )


def require_chunk(path: Path, what: str, size: int) -> None:
    """Raise unless a part of a file, which can be unpacked only as a whole, may have ``size``.

    Raises:
        ConfigError: it is larger than a chunk of a recording may be.
    """
    if size > largest_chunk():
        claimed = f"{what} of {size} bytes, more than the {largest_chunk() >> 20} MiB of the bound"
        raise _too_large(path, claimed, -(-size >> 20))


def require_held(path: Path, sizes: Iterator[int]) -> None:
    """Raise unless what a library holds in memory as a whole may have the sum of ``sizes``.

    Raises:
        ConfigError: it has more than all chunks of a small recording, and 50 times the file.
    """
    bound = max(most(0), 50 * path.stat().st_size)
    if not has_at_most(bound, sizes):
        what = f"arrays of more than {bound} bytes, which is more than 50 times the file"
        raise _too_large(path, what, _doubled())


def unpacked_sizes(packed: bytes) -> Iterator[int]:
    """Yield the sizes of the parts of zlib data, unpacked one after the other.

    Damaged data end early: the library that reads the file names that.
    """
    unpacker = zlib.decompressobj()
    try:
        part = unpacker.decompress(packed, _PIECE)
        while part or unpacker.unconsumed_tail:
            yield len(part)
            part = unpacker.decompress(unpacker.unconsumed_tail, _PIECE)
    except zlib.error:
        return


def has_at_most(total: int, sizes: Iterator[int]) -> bool:
    """Return whether ``sizes`` are not more than ``total`` together; no more of them are taken."""
    for size in sizes:
        total -= size
        if total < 0:
            return False
    return True


def _doubled() -> int:
    return 2 * largest_chunk() >> 20


def _too_large(path: Path, what: str, mib: int) -> ConfigError:
    return ConfigError(
        f"the file states, or unpacks to, {what}",
        place=Place(str(path), 1, 1),
        hint=f"if you trust the file and there is memory for it, set {CHUNK_VARIABLE}={mib} in the "
        "environment, the most MiB that rigd unpacks at once",
    )
