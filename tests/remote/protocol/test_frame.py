"""Frames: pinned to bytes, and refused if their content contradicts their header."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from rigd.remote.protocol import Frame, Refusal, decode_frame, encode_frame

#: Two points of two channels, written by hand from the description in docs/remote.md.
GOLDEN = (
    b"RGF1"
    + struct.pack("<HHIIQ", 3, 2, 2, 7, 1_700_000_000_000_000_000)
    + struct.pack("<2d", 0.0, 0.5)
    + struct.pack("<4f", -1.0, -2.0, 1.0, 2.0)
    + struct.pack("<4f", -3.0, -4.0, 3.0, 4.0)
)
FRAME = Frame(
    stream=3,
    sequence=7,
    t0_ns=1_700_000_000_000_000_000,
    time_s=np.array([0.0, 0.5]),
    low=np.array([[-1.0, -2.0], [-3.0, -4.0]], np.float32),
    high=np.array([[1.0, 2.0], [3.0, 4.0]], np.float32),
)


def test_encoded_frame_matches_documented_bytes() -> None:
    assert encode_frame(FRAME) == GOLDEN


def test_the_bytes_are_read_as_documented() -> None:
    got = decode_frame(GOLDEN)
    assert (got.stream, got.sequence, got.t0_ns) == (3, 7, 1_700_000_000_000_000_000)
    np.testing.assert_array_equal(got.time_s, FRAME.time_s)
    np.testing.assert_array_equal(got.low, FRAME.low)
    np.testing.assert_array_equal(got.high, FRAME.high)


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"RGF1",
        b"RGF2" + GOLDEN[4:],
        GOLDEN[:-1],
        GOLDEN + b"\x00",
        b"RGF1" + struct.pack("<HHIIQ", 0, 65535, 2**32 - 1, 0, 0),
    ],
)
def test_bytes_that_are_no_frame_are_refused(payload: bytes) -> None:
    with pytest.raises(Refusal):
        decode_frame(payload)


def test_shapes_that_do_not_agree_are_refused() -> None:
    with pytest.raises(ValueError, match="shapes do not agree"):
        encode_frame(Frame(0, 0, 0, np.zeros(3), FRAME.low, FRAME.high))


def test_a_frame_too_large_is_refused() -> None:
    values = np.zeros((1, 5000), np.float32)
    with pytest.raises(ValueError, match="at most"):
        encode_frame(Frame(0, 0, 0, np.zeros(5000), values, values))
