"""Records that rigd encodes itself have the bytes of the library, which encodes the others."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st
from mcap.records import ChunkIndex

from rigd.record.mcap.wire import FRAME, decode_chunk_index, encode, encode_chunk_index

NUMBERS = st.integers(0, 2**64 - 1)
INDEXES = st.builds(
    ChunkIndex,
    chunk_length=NUMBERS,
    chunk_start_offset=NUMBERS,
    compression=st.sampled_from(["", "lz4", "zstd"]),
    compressed_size=NUMBERS,
    message_end_time=NUMBERS,
    message_index_length=NUMBERS,
    message_index_offsets=st.dictionaries(st.integers(0, 2**16 - 1), NUMBERS, max_size=5),
    message_start_time=NUMBERS,
    uncompressed_size=NUMBERS,
)


@given(index=INDEXES)
def test_chunk_index_has_the_librarys_bytes(index: ChunkIndex) -> None:
    encoded = encode_chunk_index(index)

    assert encoded == encode(index)
    assert decode_chunk_index(memoryview(encoded)[FRAME.size :]) == index
