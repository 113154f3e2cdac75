"""Recording against the `mcap` library: CPU time per message, as ratios of one interleaved run.

12 float64 fields, one message per sample, one stream, 100 rows a call. The library gets its
messages ready packed, so that only framing, chunking, compression and writing are compared; both
write to real files with CRCs. Zstd is at level 1 on both sides: the library, which leaves no choice
and takes level 3, is given a compressor of level 1, kept from chunk to chunk as ours is. Each keeps
its own chunk size and, of zstd, the other settings. The rigd writer flushes itself as it would in a
run without pauses.

Each is done once untimed right before it is timed: memory that is free for a while a virtual
machine gives back to its host, and the next program that touches it pays 7 µs a page, ten times
what writing the page costs. What takes less than 0.2 s is repeated up to that, and its median
taken.

    python benchmarks/recording.py [--rows 200000] [--rounds 7]
"""

from __future__ import annotations

import argparse
import itertools
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Final

import mcap.writer
import numpy as np
import zstandard
from figures import at_least
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from rigd.model import Channel, Stream
from rigd.model.rows import row_dtype
from rigd.record import Recording, RecordingWriter
from rigd.record.compression import ZSTD_LEVEL, Compression
from rigd.record.schema import schema_text

FIELDS: Final = 12
ROWS_PER_CALL: Final = 100
STREAM: Final = Stream("signals", tuple(Channel(f"c{i}") for i in range(FIELDS)))
LIBRARY: Final[dict[Compression, CompressionType]] = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}
LEAST_S: Final = 0.2
#: What we want to reach: how many times less CPU than the library.
WRITE_TARGETS: Final[dict[Compression, float]] = {"none": 20, "lz4": 10, "zstd": 10}
READ_TARGETS: Final[dict[Compression, float]] = {"none": 25, "lz4": 15, "zstd": 15}


@dataclass(frozen=True)
class Line:
    """One line of the table: CPU in µs per message of each round."""

    name: str
    library_us: list[float]
    rigd_us: list[float]
    target: float

    @property
    def ratios(self) -> list[float]:
        """How many times less CPU rigd needs, in each round."""
        return [theirs / ours for theirs, ours in zip(self.library_us, self.rigd_us, strict=True)]


def signals(count: int, seed: int) -> NDArray[np.void]:
    """Return rows that compress like friction data, to about 60 %: half of them with noise."""
    rng = np.random.default_rng(seed)
    rows = np.zeros(count, row_dtype(STREAM))
    rows["t_ns"] = 1_790_000_000_000_000_000 + np.arange(count, dtype=np.int64) * 100_000
    phase = np.arange(count) * 1e-4
    for position, channel in enumerate(STREAM.channels):
        wave = np.sin(2 * np.pi * (0.2 + position) * phase)
        if position % 2:
            # As from a 16-bit converter; the other half uses every bit, as a simulation does.
            wave = np.round((wave + 1e-3 * rng.normal(size=count)) * 3276.8) / 3276.8
        rows[channel.name] = wave
    return rows


@contextmanager
def library_level(level: int) -> Iterator[None]:
    """Have the library compress at this level."""
    names = vars(mcap.writer)
    original = names["zstandard"]
    names["zstandard"] = SimpleNamespace(compress=zstandard.ZstdCompressor(level=level).compress)
    try:
        yield
    finally:
        names["zstandard"] = original


def write_library(path: Path, payloads: list[bytes], times: list[int], how: Compression) -> None:
    with path.open("wb") as file, library_level(ZSTD_LEVEL):
        writer = Writer(file, compression=LIBRARY[how])
        writer.start("ros2", "benchmark")
        schema = writer.register_schema("rigd/msg/Signals", "ros2msg", schema_text(STREAM).encode())
        channel = writer.register_channel("/signals", "cdr", schema)
        for number, (t_ns, payload) in enumerate(zip(times, payloads, strict=True)):
            writer.add_message(channel, t_ns, payload, t_ns, number)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped
        file.flush()
        os.fdatasync(file.fileno())  # as closing a recording does


def write_rigd(path: Path, rows: NDArray[np.void], how: Compression) -> None:
    path.unlink(missing_ok=True)
    with RecordingWriter.create(
        path,
        streams=(STREAM,),
        metadata={},
        attachments=(),
        start_ns=int(rows["t_ns"][0]),
        compression=how,
        sync_interval_s=None,
    ) as writer:
        for start in range(0, len(rows), ROWS_PER_CALL):
            writer.write("signals", rows[start : start + ROWS_PER_CALL])


def read_library(path: Path) -> int:
    """Read all messages in file order; joining their payloads is the least that makes columns."""
    with path.open("rb") as file:
        messages = make_reader(file).iter_messages(log_time_order=False)
        joined = b"".join(message.data for _, _, message in messages)
    return len(np.frombuffer(joined, np.dtype([("cdr", "V4"), ("values", "<f8", (FIELDS,))])))


def cpu_us(action: Callable[[], object], messages: int) -> float:
    """Return the CPU time of all threads in µs per message: a median, the first not counted."""
    action()
    times: list[float] = []
    while not times or sum(times) < LEAST_S:
        before = time.process_time()
        action()
        times.append(time.process_time() - before)
    return statistics.median(times) * 1e6 / messages


def measure(count: int, rounds: int, seed: int) -> list[Line]:
    """Return the lines of the table; library and rigd take turns within each round."""
    rows = signals(count, seed)
    payloads = [b"\x00\x01\x00\x00" + row.tobytes()[8:] for row in rows]
    times = rows["t_ns"].tolist()
    taken: dict[tuple[str, Compression, str], list[float]] = {}
    with tempfile.TemporaryDirectory() as folder:
        theirs, ours = Path(folder, "theirs.mcap"), Path(folder, "ours.mcap")
        for _, how in itertools.product(range(rounds), LIBRARY):
            pairs: list[tuple[str, str, Callable[[], object]]] = [
                ("write", "library", partial(write_library, theirs, payloads, times, how)),
                ("write", "rigd", partial(write_rigd, ours, rows, how)),
                ("read", "library", partial(read_library, theirs)),
                ("read", "rigd", lambda: Recording.open(ours).read("signals")),
            ]
            for what, library, action in pairs:
                taken.setdefault((what, how, library), []).append(cpu_us(action, count))
            assert Recording.open(ours).read("signals").tobytes() == rows.tobytes()
    return [
        Line(
            f"{what} {how}",
            taken[what, how, "library"],
            taken[what, how, "rigd"],
            targets[how],
        )
        for what, targets in (("write", WRITE_TARGETS), ("read", READ_TARGETS))
        for how in LIBRARY
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else None)
    parser.add_argument("--rows", type=int, default=200_000)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seed", type=int, default=time.time_ns() % 2**32)
    options = parser.parse_args()
    print(f"{options.rows} messages of {FIELDS} float64, {options.rounds} rounds, ", end="")
    print(f"seed {options.seed}; CPU in µs per message, medians")
    print(f"{'':12}{'mcap':>9}{'rigd':>9}{'ratio':>9}{'least':>9}{'most':>9}{'target':>9}")
    lines = measure(options.rows, options.rounds, options.seed)
    for line in lines:
        theirs, ours = statistics.median(line.library_us), statistics.median(line.rigd_us)
        low, middle, high = min(line.ratios), statistics.median(line.ratios), max(line.ratios)
        print(
            f"{line.name:12}{theirs:9.2f}{ours:9.3f}{middle:8.1f}x{low:8.1f}x{high:8.1f}x"
            f"{line.target:8.0f}x"
        )
    for line in lines:
        at_least(f"recording, {line.name}", statistics.median(line.ratios), line.target)


if __name__ == "__main__":
    main()
