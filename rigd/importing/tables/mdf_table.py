"""Reads MDF4 files with asammdf: the channels of one channel group."""

from __future__ import annotations

import gc
import mmap
import struct
import sys
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from asammdf import MDF
from asammdf.blocks.utils import MdfException
from numpy.typing import NDArray

from rigd.importing.tables.array_table import ArrayColumn, ArrayTable
from rigd.importing.tables.bounds import has_at_most, require_chunk, unpacked_sizes
from rigd.importing.tables.parquet_table import unreadable
from rigd.model.errors import ConfigError, Place
from rigd.record.mcap.compression import decompress
from rigd.record.mcap.wire import Malformed

#: The column of the times of a channel group, in s since the file's start.
TIME: Final = "(time)"
#: How a file begins, and one that its program did not finish.
_MAGIC: Final = b"MDF     "
_NOT_FINISHED: Final = b"UnFinMF "
#: A compressed block (ASAM MDF 4.2, DZBLOCK): identifier, length, links, type of the block, of the
#: compression, reserved, its parameter, size of the data before it and after it, in bytes.
_BLOCK: Final = struct.Struct("<8sQQ2sBBIQQ")
_ZIPPED: Final = b"##DZ\0\0\0\0"
_DEFLATED: Final = (0, 1)  #: the second transposed before
#: Others of ASAM MDF 4.3.
_CODECS: Final = {2: "zstd", 3: "zstd", 4: "lz4", 5: "lz4"}


def open_mdf(path: Path, group: str | None) -> ArrayTable:
    """Return the channels of a channel group as a table; ``group`` is its number, or its name.

    Raises:
        ConfigError: the file is cut off, damaged or no MDF, or has no such group.
    """
    with _file(path) as file:
        _number(path, file, group)
        begun = file.header.start_time
        aware = begun if begun.tzinfo else begun.replace(tzinfo=UTC)
        since = aware - datetime(1970, 1, 1, tzinfo=UTC)
        start_ns = getattr(file.header, "abs_time", None)
        if not isinstance(start_ns, int) or abs(start_ns * 1e-9 - since.total_seconds()) > 1.0:
            start_ns = round(since.total_seconds() * 1e6) * 1000
    return ArrayTable(path, partial(_opened, path, group), start_ns if start_ns > 0 else None)


def mdf_groups(path: Path) -> list[str]:
    """Return the numbers of the channel groups of a file that have samples.

    Raises:
        ConfigError: the file is cut off, damaged or no MDF.
    """
    with _file(path) as file:
        return [str(at) for at, item in enumerate(file.groups) if int(item.channel_group.cycles_nr)]


@contextmanager
def _file(path: Path) -> Iterator[Any]:
    with path.open("rb") as stream:
        if stream.read(len(_MAGIC)) not in (_MAGIC, _NOT_FINISHED):
            raise ConfigError(
                "the file is cut off, damaged or no MDF: it does not begin as one does",
                place=Place(str(path), 1, 1),
            )
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as mapped:
            _require_small_blocks(path, mapped)
        stream.seek(0)
        try:
            file = MDF(stream)
        except (
            OSError, ValueError, MdfException, KeyError, struct.error, MemoryError, OverflowError
        ) as error:  # fmt: skip
            _free(error)
            raise unreadable(path, "MDF", error) from None
        with file:
            yield file


def _require_small_blocks(path: Path, file: mmap.mmap) -> None:
    """Raise unless each compressed block of a file may be unpacked: asammdf does so as a whole.

    Raises:
        ConfigError: a block states, or has, more bytes than rigd unpacks.
    """
    at = -1
    while (at := file.find(_ZIPPED, at + 1)) >= 0:
        if at + _BLOCK.size > len(file):
            return
        _, length, links, _, kind, _, _, stated, packed = _BLOCK.unpack_from(file, at)
        # Else the letters are part of samples.
        if links == 0 and _BLOCK.size + packed <= length <= len(file) - at:
            require_chunk(path, f"a block at byte {at}", stated)
            begin = at + _BLOCK.size
            if not _keeps_size(kind, file[begin : begin + packed], stated):
                raise ConfigError(
                    f"the block at byte {at} does not unpack to the {stated} bytes that it "
                    "states: the file is damaged",
                    place=Place(str(path), 1, 1),
                )
            at = begin + packed - 1


def _keeps_size(kind: int, packed: bytes, stated: int) -> bool:
    """Return whether a block of a ``kind`` of compression unpacks to no more than ``stated``."""
    if kind in _DEFLATED:
        return has_at_most(stated, unpacked_sizes(packed))
    try:
        return kind not in _CODECS or bool(decompress(memoryview(packed), _CODECS[kind], stated))
    except Malformed:
        return False


def _free(error: BaseException) -> None:
    """Free the half-made object of asammdf in the frames of ``error``.

    Freed later, it would print an error of its own, since it lacks what its end needs.
    """
    hook, sys.unraisablehook = sys.unraisablehook, lambda _: None
    try:
        traceback.clear_frames(error.__traceback__)
        gc.collect()
    finally:
        sys.unraisablehook = hook


def _number(path: Path, file: Any, group: str | None) -> int:
    names = [str(item.channel_group.acq_name or "") for item in file.groups]
    if group is None and len(names) == 1:
        return 0
    if group is not None and group in names:
        return names.index(group)
    if group is not None and group.isdecimal() and int(group) < len(names):
        return int(group)
    listed = ", ".join(f"{at} {name}".strip() for at, name in enumerate(names))
    what = (
        f"has {len(names)} channel groups" if group is None else f"has no channel group {group!r}"
    )
    raise ConfigError(f"{path} {what}", hint=f"give `group:`, the number or name of: {listed}")


@contextmanager
def _opened(path: Path, group: str | None) -> Iterator[Sequence[ArrayColumn]]:
    with _file(path) as file:
        number = _number(path, file, group)
        found = file.groups[number]
        rows = int(found.channel_group.cycles_nr)
        masters = file.masters_db
        columns = []
        for index, channel in enumerate(found.channels):
            if masters.get(number) == index:
                columns.append(ArrayColumn(TIME, "s", rows, False, partial(_times, file, number)))
                continue
            probe = _read(file, number, index, 0, min(1, rows))
            unit = str(getattr(channel, "unit", "") or "")
            columns.append(
                ArrayColumn(
                    channel.name, unit, rows, probe.dtype.kind in "iu",
                    partial(_read, file, number, index),
                )
            )  # fmt: skip
        yield columns


def _read(file: Any, group: int, index: int, start: int, end: int) -> NDArray[Any]:
    """Return the samples of a channel; those that the file marks as invalid are NaN, or ""."""
    signal = file.get(
        group=group, index=index, record_offset=start, record_count=end - start,
        ignore_invalidation_bits=True,
    )  # fmt: skip
    values = np.asarray(signal.samples)
    if signal.invalidation_bits is None:
        return values
    invalid = np.asarray(signal.invalidation_bits, np.bool_)
    if values.dtype.kind in "iufb":
        return np.where(invalid, np.nan, values) if invalid.any() else values
    return np.where(invalid, np.zeros((), values.dtype), values)


def _times(file: Any, group: int, start: int, end: int) -> NDArray[np.float64]:
    times = file.get_master(group, record_offset=start, record_count=end - start)
    return np.asarray(times, np.float64)
