"""Encodes and decodes live data as binary frames: minimum and maximum of each channel per point.

A frame is little-endian and contains, in this order:

- the header of 24 bytes: ``RGF1``, u16 number of the stream, u16 channels, u32 points, u32
  sequence, u64 t0 in ns since the Unix epoch;
- ``points`` f64: seconds since t0;
- for each channel, ``points`` f32 minima and then ``points`` f32 maxima.

Because the header has 24 bytes, a browser can read the data after the header as typed arrays.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rigd.remote.protocol.limits import MAX_FRAME_CHANNELS, MAX_FRAME_POINTS
from rigd.remote.protocol.refusal import Code, Refusal

MAGIC: Final = b"RGF1"
HEADER: Final = struct.Struct("<4sHHIIQ")


@dataclass(frozen=True, eq=False)
class Frame:
    """A piece of one stream, newest point last.

    ``time_s`` has shape (points,); ``low`` and ``high`` have shape (channels, points), in the units
    of ``describe``, NaN if nothing was measured. ``sequence`` counts the frames of the stream: a
    gap is a frame that was dropped on the way.
    """

    stream: int
    sequence: int
    t0_ns: int
    time_s: NDArray[np.float64]
    low: NDArray[np.float32]
    high: NDArray[np.float32]


def encode_frame(frame: Frame) -> bytes:
    """Return the bytes of a frame.

    Raises:
        ValueError: the shapes do not agree, or there are too many points or channels.
    """
    channels, points = frame.low.shape
    if frame.high.shape != (channels, points) or frame.time_s.shape != (points,):
        raise ValueError(
            f"shapes do not agree: time {frame.time_s.shape}, low {frame.low.shape}, "
            f"high {frame.high.shape}"
        )
    if points > MAX_FRAME_POINTS or channels > MAX_FRAME_CHANNELS:
        raise ValueError(
            f"{channels} channels x {points} points, at most "
            f"{MAX_FRAME_CHANNELS} x {MAX_FRAME_POINTS}"
        )
    head = HEADER.pack(
        MAGIC, frame.stream, channels, points, frame.sequence & 0xFFFFFFFF, frame.t0_ns
    )
    values = np.stack((frame.low, frame.high), axis=1).astype("<f4", copy=False)
    return head + frame.time_s.astype("<f8", copy=False).tobytes() + values.tobytes()


def decode_frame(payload: bytes) -> Frame:
    """Return the frame that ``payload`` holds.

    Raises:
        Refusal: it is not a frame.
    """
    if len(payload) < HEADER.size or payload[:4] != MAGIC:
        raise Refusal(Code.BAD_REQUEST, f"not a frame: begins with {payload[:4]!r}")
    _, stream, channels, points, sequence, t0_ns = HEADER.unpack_from(payload)
    size = HEADER.size + 8 * points + 8 * channels * points
    if points > MAX_FRAME_POINTS or channels > MAX_FRAME_CHANNELS or len(payload) != size:
        raise Refusal(
            Code.BAD_REQUEST,
            f"a frame of {channels} channels x {points} points has {size} bytes, "
            f"not {len(payload)}",
        )
    time_s = np.frombuffer(payload, "<f8", points, HEADER.size)
    values = np.frombuffer(payload, "<f4", 2 * channels * points, HEADER.size + 8 * points)
    values = values.reshape(channels, 2, points)
    return Frame(stream, sequence, t0_ns, time_s, values[:, 0], values[:, 1])
