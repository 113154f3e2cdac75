"""Decodes the uncompressed bytes of a chunk to rows.

rigd writes chunks of one channel whose messages all have the same size: numpy converts all rows at
once. Other programs mix channels in a chunk: each message is found first, and then numpy takes
those of a channel at once. What was found is kept, as every stream reads the same chunks.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache, cached_property
from threading import Lock
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.record.events.event import CDR_HEADER, MESSAGE_FIELDS
from rigd.record.mcap.chunks import (
    CDR_SIZE,
    MESSAGE_HEAD,
    Places,
    message_dtype,
    message_places,
    uniform_messages,
)
from rigd.record.mcap.wire import FRAME, Malformed
from rigd.record.read.messages.fields import Decode

#: The numbers of the channels of a topic; a file of another program may have several.
Channels = tuple[int, ...]

_CDR = np.frombuffer(CDR_HEADER, "<u4")[0]
#: Most bytes of chunks of mixed channels that are kept, beside the newest one.
KEPT_BYTES: Final = 64 << 20


#: Fields of :func:`numbered_dtype`, and those of a message that they are.
_HEAD: Final = {"t_ns": "log_time", "sequence": "sequence", "publish_ns": "publish_time"}


@cache
def numbered_dtype(blob: np.dtype[np.void]) -> np.dtype[np.void]:
    """Return the dtype of a row (``blob``: time, values) with all that identifies its message."""
    head = [("t_ns", "<u8"), ("sequence", "<u4"), ("publish_ns", "<u8")]
    return np.dtype([*head, ("values", blob["values"])])


def in_order(rows: NDArray[np.void]) -> NDArray[np.void]:
    """Return rows of :func:`numbered_dtype` by time and number, each once."""
    times = rows["t_ns"]
    if (times[1:] > times[:-1]).all():
        return rows
    rows = rows[np.lexsort((rows["sequence"], rows["t_ns"]))]
    same = rows["t_ns"][1:] == rows["t_ns"][:-1]
    tied = np.flatnonzero(np.append(same, False) | np.append(False, same))
    if not len(tied):
        return rows
    contents = np.ascontiguousarray(rows[tied]).view(f"V{rows.dtype.itemsize}")
    first = {
        content: at
        for at, content in zip(tied[::-1].tolist(), contents[::-1].tolist(), strict=True)
    }
    kept = np.ones(len(rows), bool)
    kept[tied] = False
    kept[list(first.values())] = True
    return rows[kept]


def _swapped(values: NDArray[np.void]) -> NDArray[np.void]:
    """Return values of the other byte order: float64s, then a status word if 4 bytes are left."""
    size = values.dtype.itemsize
    fields = [("values", ">f8", (size // 8,)), *([("status", ">u4")] if size % 8 else [])]
    big = np.dtype(fields)
    return np.ascontiguousarray(values).view(big).astype(big.newbyteorder("<")).view(values.dtype)


@dataclass(frozen=True, eq=False)
class Messages:
    """The messages of one uncompressed chunk.

    ``alike`` are all of them, if they are of one channel and one size; else ``places`` has each.
    """

    data: bytes | memoryview
    alike: NDArray[np.void] | None
    places: Places | None

    @classmethod
    def of(cls, data: bytes | memoryview) -> Messages:
        """Return the messages of a chunk.

        Raises:
            Malformed: the data ends within a record, or a message is too short.
        """
        alike = uniform_messages(data)
        return cls(data, alike, message_places(data) if alike is None else None)

    def rows(self, channels: Channels, blob: np.dtype[np.void]) -> NDArray[np.void]:
        """Return the rows of the channels of one stream as ``blob`` (time, values as one blob).

        Raises:
            Malformed: a message has another size or byte order than its stream.
        """
        value_bytes = blob.itemsize - 8
        found = self._taken(channels, value_bytes)
        if not len(found):
            return np.empty(0, blob)
        if found["values"].dtype.itemsize != value_bytes:
            raise Malformed("a message whose size does not fit its stream")
        if (found["cdr"] != _CDR).any():
            raise Malformed("a message that is not little-endian CDR")
        rows = np.empty(len(found), blob)
        rows["t_ns"] = found["log_time"]
        rows["values"] = found["values"]
        return rows

    def numbered(
        self, channels: Channels, blob: np.dtype[np.void], decoders: Mapping[int, Decode]
    ) -> NDArray[np.void]:
        """Return the rows of the channels of one stream as :func:`numbered_dtype`.

        Of a file of another program: channels in ``decoders`` are decoded one by one, the others
        are plain CDR, in any byte order and with any bytes behind their values. A message that
        does not fit its type gives a row of NaN.
        """
        dtype, parts = numbered_dtype(blob), []
        for channel in channels:
            if channel in decoders:
                parts.append(self._decoded(channel, dtype, decoders[channel]))
            else:
                parts.append(self._plain(channel, dtype))
        return np.concatenate(parts) if len(parts) > 1 else parts[0]

    def _plain(self, channel: int, dtype: np.dtype[np.void]) -> NDArray[np.void]:
        places, message = self._all, message_dtype(dtype["values"].itemsize)
        mine = places.channels == channel
        offsets, fits = places.offsets[mine], places.sizes[mine] >= message.itemsize
        rows = self._heads(offsets, dtype)
        found = self._at(offsets[fits], message)
        values = found["values"].copy()
        # The second byte of the header is odd for little-endian; the last two are options.
        big = found["cdr"] >> 8 & 1 == 0
        if big.any():
            values[big] = _swapped(values[big])
        rows["values"][fits] = values
        return rows

    def _decoded(self, channel: int, dtype: np.dtype[np.void], decode: Decode) -> NDArray[np.void]:
        places, view = self._all, memoryview(self.data)
        mine = places.channels == channel
        rows = self._heads(places.offsets[mine], dtype)
        values = rows["values"].view(f"({dtype['values'].itemsize // 8},)<f8")
        begin = FRAME.size + MESSAGE_FIELDS.size
        spans = zip(places.offsets[mine].tolist(), places.sizes[mine].tolist(), strict=True)
        for row, (at, size) in enumerate(spans):
            with suppress(Malformed):
                values[row] = decode(view[at + begin : at + size])
        return rows

    def _heads(self, offsets: NDArray[np.int64], dtype: np.dtype[np.void]) -> NDArray[np.void]:
        """Return rows with times and number of the messages at ``offsets``, and values of NaN."""
        rows, heads = np.empty(len(offsets), dtype), self._at(offsets, MESSAGE_HEAD)
        for name, source in _HEAD.items():
            rows[name] = heads[source]
        size = dtype["values"].itemsize
        unknown = np.full(size // 8, np.nan, "<f8").tobytes() + bytes(size % 8)
        rows["values"] = np.frombuffer(unknown, dtype["values"])[0]
        return rows

    def _at(self, offsets: NDArray[np.int64], dtype: np.dtype[np.void]) -> NDArray[np.void]:
        """Return what stands at ``offsets`` (n,) as a ``dtype``, (n,)."""
        if not len(offsets):
            return np.empty(0, dtype)
        octets = np.frombuffer(self.data, np.uint8)
        taken = np.lib.stride_tricks.sliding_window_view(octets, dtype.itemsize)[offsets]
        return np.asarray(taken.view(dtype)[:, 0])

    @cached_property
    def _all(self) -> Places:
        return self.places or message_places(self.data)

    def payloads(self, channels: Channels) -> Iterator[tuple[int, memoryview]]:
        """Yield (log time in ns, payload) of each message of the channels."""
        return ((t_ns, payload) for t_ns, _, payload in self.numbers(channels))

    def numbers(self, channels: Channels) -> Iterator[tuple[int, int, memoryview]]:
        """Yield (log time in ns, number, payload) of each message of the channels."""
        places = self._all
        view, mine = memoryview(self.data), np.isin(places.channels, channels)
        spans = zip(places.offsets[mine].tolist(), places.sizes[mine].tolist(), strict=True)
        for offset, size in spans:
            at = offset + FRAME.size
            _, number, t_ns, _ = MESSAGE_FIELDS.unpack_from(view, at)
            yield t_ns, number, view[at + MESSAGE_FIELDS.size : offset + size]

    def _taken(self, channels: Channels, value_bytes: int) -> NDArray[np.void]:
        """Return the messages of the channels as :func:`message_dtype`, (n,)."""
        if self.alike is not None:
            return self.alike if int(self.alike["channel"][0]) in channels else self.alike[:0]
        places, dtype = self._all, message_dtype(value_bytes)
        mine = np.isin(places.channels, channels)
        offsets = places.offsets[mine]
        if (places.sizes[mine] != MESSAGE_HEAD.itemsize + CDR_SIZE + value_bytes).any():
            raise Malformed("a message whose size does not fit its stream")
        return self._at(offsets, dtype)


@dataclass
class KeptMessages:
    """The newest chunks of mixed channels: every stream, and each trial, reads them again.

    The key of a chunk has its place, size and CRC, so that one which changed is read again.
    """

    _kept: dict[tuple[int, int, int], Messages] = field(default_factory=dict)
    _lock: Lock = field(default_factory=Lock)

    def get(self, key: tuple[int, int, int]) -> Messages | None:
        """Return the messages of a chunk, None if they are not kept."""
        return self._kept.get(key)

    def keep(self, key: tuple[int, int, int], messages: Messages) -> None:
        """Keep the messages of a chunk, and drop the oldest ones beyond :data:`KEPT_BYTES`."""
        with self._lock:
            self._kept[key] = messages
            size = sum(len(item.data) for item in self._kept.values())
            while len(self._kept) > 1 and size > KEPT_BYTES:
                size -= len(self._kept.pop(next(iter(self._kept))).data)
