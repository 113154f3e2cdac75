"""Sealed blocks on their way to the file: made into chunks, compressed in a thread."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from typing import Final

from rigd.record.chunks import Block, Chunk, build_chunk
from rigd.record.compression import Compression, compressor
from rigd.record.openchunk import OpenChunk

_AS_IT_IS: Final = compressor("none")


class Sealer:
    """Chunks that are sealed and not yet in the file, in the order in which they were sealed.

    Not compressed, there is nothing worth a thread: the chunk is made at once.
    """

    def __init__(self, compression: Compression) -> None:
        self._compression = compression
        self._compress = compressor(compression)
        self._waiting: list[tuple[OpenChunk, Future[Chunk]]] = []
        self._thread = (
            ThreadPoolExecutor(1, thread_name_prefix="compress") if compression != "none" else None
        )

    def __len__(self) -> int:
        """Return the number of chunks that wait to be written."""
        return len(self._waiting)

    def seal(self, held: OpenChunk) -> None:
        """Take what is held, to be made a chunk."""
        block = held.take()
        if self._thread is None:
            made: Future[Chunk] = Future()
            made.set_result(self._build(block))
        else:
            made = self._thread.submit(self._build, block)
        self._waiting.append((held, made))

    def chunks(self) -> list[Chunk]:
        """Return the chunks to be written; waits for the thread."""
        return [made.result() for _, made in self._waiting]

    def written(self) -> None:
        """Forget the chunks; their memory is filled anew."""
        for held, _ in self._waiting:
            held.give_back()
        self._waiting.clear()

    def close(self) -> None:
        """End the thread; silent the second time."""
        if self._thread is not None:
            self._thread.shutdown(cancel_futures=True)

    def _build(self, block: Block) -> Chunk:
        return build_chunk(block, self._compression, self._compress)


def open_chunk(held: OpenChunk) -> Chunk:
    """Return what is held as it is put behind the sealed chunks until the next flush.

    Not compressed: it is written again at each flush until it is sealed.
    """
    return build_chunk(held.block(), "none", _AS_IT_IS)
