"""Compresses chunks with zstd or lz4; the same data give the same bytes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Literal

import lz4.frame
import numpy as np
import zstandard

from rigd.record.mcap.bounds import permit
from rigd.record.mcap.wire import Malformed

Compression = Literal["zstd", "lz4", "none"]
#: What rigd unpacks, by the names in MCAP.
COMPRESSIONS: Final = ("", "lz4", "zstd")
#: Makes a block of bytes smaller; not for two threads at once.
Compressor = Callable[[memoryview], bytes]

#: Level 1: twice as fast as 3 for 3 to 8 % more bytes on friction signals (2026 measurement).
ZSTD_LEVEL: Final = 1
#: A table of 16 instead of 64 KiB, which leaves room beside it in the L1 cache: 3 to 10 % faster
#: on friction signals, and no byte more: the repeating bytes of rows are found one row back.
ZSTD_HASH_LOG: Final = 12
#: Bytes that are unpacked from lz4 at once.
_LZ4_PIECE: Final = 4 << 20


def compressor(compression: Compression) -> Compressor:
    """Return the function that compresses one block after another; it keeps its tables.

    That of ``none`` returns a copy: a block is filled again before it is written.
    """
    if compression == "zstd":
        parameters = zstandard.ZstdCompressionParameters.from_level(
            ZSTD_LEVEL, hash_log=ZSTD_HASH_LOG
        )
        return zstandard.ZstdCompressor(compression_params=parameters).compress
    if compression == "lz4":
        return _lz4
    return bytes


def decompress(packed: memoryview, compression: str, size: int) -> bytes | memoryview:
    """Return the decompressed data; ``compression`` is the name that a chunk has in MCAP.

    Takes no more memory than ``size``, and no more than :mod:`~rigd.record.mcap.bounds` permits.

    Raises:
        Malformed: unknown compression, or data that does not decompress to ``size`` bytes.
        TooLarge: more than is permitted.

    """
    if compression == "":
        if len(packed) != size:
            raise Malformed(f"a chunk of {len(packed)} bytes that should have {size}")
        return packed
    try:
        if compression == "zstd":
            # Of a frame that states its size, zstandard ignores `max_output_size`.
            _require_stated(stated_size(packed, compression), size)
            permit(size)
            data: bytes | memoryview = zstandard.ZstdDecompressor().decompress(
                packed, max_output_size=max(size, 1)
            )
        elif compression == "lz4":
            if size > _LZ4_PIECE:  # 0 is that of a frame that states none
                _require_stated(stated_size(packed, compression), size)
            permit(size)
            data = _lz4_unpacked(packed, size)
        else:
            raise Malformed(f"a chunk compressed with {compression!r}, which rigd cannot read")
    except (zstandard.ZstdError, RuntimeError) as error:
        raise Malformed(f"a chunk that does not decompress ({error})") from error
    if len(data) != size:
        raise Malformed(f"a chunk whose data do not have the {size} bytes that it states")
    return data


def decompress_begin(packed: memoryview, compression: str, size: int) -> bytes:
    """Return the first ``size`` bytes of the decompressed data; the rest may be damaged.

    Raises:
        Malformed: unknown compression, or not so many bytes can be decompressed.

    """
    data = b""
    try:
        if compression == "zstd":
            data = zstandard.ZstdDecompressor().stream_reader(packed).read(size)
        elif compression == "lz4":
            context = lz4.frame.create_decompression_context()
            data = lz4.frame.decompress_chunk(context, packed, max_length=size)[0]
        elif compression == "":
            data = bytes(packed[:size])
    except (zstandard.ZstdError, RuntimeError) as error:
        raise Malformed(f"a chunk that does not decompress ({error})") from error
    if len(data) < size:
        raise Malformed("a chunk of which nothing can be read")
    return data


def stated_size(packed: memoryview, compression: str) -> int:
    """Return how many bytes the compressed data say that they become; -1 if they do not.

    Raises:
        Malformed: they are no compressed data.
    """
    try:
        if compression == "zstd":
            return int(zstandard.frame_content_size(packed))
        if compression == "lz4":
            return int(lz4.frame.get_frame_info(packed)["content_size"] or -1)
    except (zstandard.ZstdError, RuntimeError) as error:
        raise Malformed(f"a chunk that does not decompress ({error})") from error
    return len(packed)


def _require_stated(stated: int, size: int) -> None:
    """Raise unless a frame states the size that its chunk does, or -1, which is none."""
    if stated not in (-1, size):
        raise Malformed(f"a chunk of {stated} bytes that should have {size}")


def _lz4_unpacked(packed: memoryview, size: int) -> bytes | memoryview:
    """Return the data of an lz4 frame, or so much of them that they are more than ``size``.

    Raises:
        Malformed: the frame ends too early.
        RuntimeError: it is damaged.
    """
    # The library copies what it returns, which takes the memory of each part twice.
    context = lz4.frame.create_decompression_context()
    part, at, ended = lz4.frame.decompress_chunk(context, packed, min(size + 1, _LZ4_PIECE))
    if ended or len(part) > size:
        return bytes(part)
    data, end = memoryview(np.empty(size + 1, np.uint8).data), 0
    while True:
        data[end : end + len(part)] = part
        end += len(part)
        if ended or end > size:
            return data[:end]
        if not part:
            raise Malformed("a chunk whose compressed data end too early")
        most = min(size + 1 - end, _LZ4_PIECE)
        part, used, ended = lz4.frame.decompress_chunk(context, packed[at:], most)
        at += used


def _lz4(data: memoryview) -> bytes:
    return bytes(lz4.frame.compress(data))
