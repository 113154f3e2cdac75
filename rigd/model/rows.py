"""Defines the memory layout of the rows of a stream, which cycle, ring and recorder share."""

from __future__ import annotations

import struct
from functools import cache

import numpy as np

from rigd.model.channels import STATUS_FIELD, Stream

#: Name of the time field: when rigd took the sample, in ns since the Unix epoch.
TIME_FIELD = "t_ns"


@cache
def row_dtype(stream: Stream) -> np.dtype[np.void]:
    """Return the structured dtype of one row: ``t_ns`` int64, float64 per channel, status uint32.

    Packed, little-endian, without padding.
    """
    fields = [(TIME_FIELD, "<i8"), *((channel.name, "<f8") for channel in stream.channels)]
    if stream.has_status:
        fields.append((STATUS_FIELD, "<u4"))
    return np.dtype(fields)


@cache
def row_struct(stream: Stream) -> struct.Struct:
    """Return the packer of one row; the same bytes as :func:`row_dtype`."""
    return struct.Struct(f"<q{len(stream.channels)}d{'I' if stream.has_status else ''}")
