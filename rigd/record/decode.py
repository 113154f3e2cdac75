"""Decodes the uncompressed bytes of a chunk to rows.

rigd writes chunks of one channel whose messages all have the same size: numpy converts all rows at
once. Other programs mix channels in a chunk: each message is found first, and then numpy takes
those of a channel at once. What was found is kept, as every stream reads the same chunks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from threading import Lock
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.record.chunks import (
    CDR_SIZE,
    MESSAGE_HEAD,
    Places,
    message_dtype,
    message_places,
    uniform_messages,
)
from rigd.record.events import CDR_HEADER, MESSAGE_FIELDS
from rigd.record.wire import FRAME, Malformed

#: The numbers of the channels of a topic; a file of another program may have several.
Channels = tuple[int, ...]

_CDR = np.frombuffer(CDR_HEADER, "<u4")[0]
#: Most bytes of chunks of mixed channels that are kept, beside the newest one.
KEPT_BYTES: Final = 64 << 20


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

    def payloads(self, channels: Channels) -> Iterator[tuple[int, memoryview]]:
        """Yield (log time in ns, payload) of each message of the channels."""
        places = self.places or message_places(self.data)
        view, mine = memoryview(self.data), np.isin(places.channels, channels)
        spans = zip(places.offsets[mine].tolist(), places.sizes[mine].tolist(), strict=True)
        for offset, size in spans:
            at = offset + FRAME.size
            yield (
                MESSAGE_FIELDS.unpack_from(view, at)[2],
                view[at + MESSAGE_FIELDS.size : offset + size],
            )

    def _taken(self, channels: Channels, value_bytes: int) -> NDArray[np.void]:
        """Return the messages of the channels as :func:`message_dtype`, (n,)."""
        if self.alike is not None:
            return self.alike if int(self.alike["channel"][0]) in channels else self.alike[:0]
        places, dtype = self.places or message_places(self.data), message_dtype(value_bytes)
        mine = np.isin(places.channels, channels)
        offsets = places.offsets[mine]
        if not len(offsets):
            return np.empty(0, dtype)
        if (places.sizes[mine] != MESSAGE_HEAD.itemsize + CDR_SIZE + value_bytes).any():
            raise Malformed("a message whose size does not fit its stream")
        octets = np.frombuffer(self.data, np.uint8)
        taken = np.lib.stride_tricks.sliding_window_view(octets, dtype.itemsize)[offsets]
        return np.asarray(taken.view(dtype)[:, 0])


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
