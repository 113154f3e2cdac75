"""Decodes the uncompressed bytes of a chunk to rows.

If all messages have the same size, numpy converts all rows at once.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from rigd.record.chunks import CDR_SIZE, uniform_messages
from rigd.record.events import CDR_HEADER, MESSAGE_FIELDS
from rigd.record.wire import Malformed, records

_CDR = np.frombuffer(CDR_HEADER, "<u4")[0]


def rows_of_chunk(
    data: bytes | memoryview, channel: int, blob: np.dtype[np.void]
) -> NDArray[np.void]:
    """Return the rows of one channel as ``blob`` (time, values as one blob).

    Raises:
        Malformed: a message has another size or byte order than its stream.
    """
    array = uniform_messages(data)
    value_bytes = blob.itemsize - 8
    if array is None:
        found = list(message_payloads(data, channel))
        if any(len(payload) != CDR_SIZE + value_bytes for _, payload in found):
            raise Malformed("a message whose size does not fit its stream")
        if any(bytes(payload[:CDR_SIZE]) != CDR_HEADER for _, payload in found):
            raise Malformed("a message that is not little-endian CDR")
        packed = b"".join(
            t_ns.to_bytes(8, "little") + bytes(payload[CDR_SIZE:]) for t_ns, payload in found
        )
        return np.frombuffer(packed, blob)
    if int(array["channel"][0]) != channel:
        return np.empty(0, blob)
    if array["values"].dtype.itemsize != value_bytes:
        raise Malformed("a message whose size does not fit its stream")
    if (array["cdr"] != _CDR).any():
        raise Malformed("a message that is not little-endian CDR")
    rows = np.empty(len(array), blob)
    rows["t_ns"] = array["log_time"]
    rows["values"] = array["values"]
    return rows


def message_payloads(data: bytes | memoryview, channel: int) -> Iterator[tuple[int, memoryview]]:
    """Yield (log time in ns, payload) of each message of one channel.

    Raises:
        Malformed: the data ends within a record.

    """
    for record in records(memoryview(data)):
        if record.opcode != Opcode.MESSAGE:
            continue
        if len(record.content) < MESSAGE_FIELDS.size:
            raise Malformed("a message that is too short")
        found, _, log_time, _ = MESSAGE_FIELDS.unpack_from(record.content)
        if found == channel:
            yield log_time, record.content[MESSAGE_FIELDS.size :]
