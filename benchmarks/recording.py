"""Recording against the `mcap` library: CPU time per message, as ratios of one interleaved run.

Two sets of messages, both in calls of 100 rows. `run` is what rigd records: all eight streams of
the first seconds of a simulated campaign of the LuGre rig, of 24 to 96 bytes a row, of which zstd
leaves a quarter. `noise` is harder to compress than any of them: one stream of 12 float64, a half
of them sines that use every bit, of which zstd leaves a half.

The library gets its messages ready packed, so that only framing, chunking, compression and writing
are compared; both write to real files with CRCs. Zstd is at level 1 on both sides: the library,
which leaves no choice and takes level 3, is given a compressor of level 1, kept from chunk to chunk
as ours is. Each keeps its own chunk size and, of zstd, the other settings. The rigd writer flushes
itself as it would in a run without pauses.

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
from identify_data import record
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from rigd.model import Channel, Stream
from rigd.model.rows import row_dtype
from rigd.record import Recording, RecordingWriter
from rigd.record.mcap.compression import ZSTD_LEVEL, Compression
from rigd.record.mcap.schema import schema_text

FIELDS: Final = 12
ROWS_PER_CALL: Final = 100
NOISE: Final = Stream("signals", tuple(Channel(f"c{i}") for i in range(FIELDS)))
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
class Messages:
    """What is recorded: streams, and the rows of each call in the order of the calls."""

    name: str
    streams: tuple[Stream, ...]
    calls: list[tuple[str, NDArray[np.void]]]

    @property
    def count(self) -> int:
        """Number of rows, each a message."""
        return sum(len(rows) for _, rows in self.calls)


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


def noise(count: int, seed: int) -> Messages:
    """Return one stream of which zstd leaves a half."""
    rng = np.random.default_rng(seed)
    rows = np.zeros(count, row_dtype(NOISE))
    rows["t_ns"] = 1_790_000_000_000_000_000 + np.arange(count, dtype=np.int64) * 100_000
    phase = np.arange(count) * 1e-4
    for position, channel in enumerate(NOISE.channels):
        wave = np.sin(2 * np.pi * (0.2 + position) * phase)
        if position % 2:
            # As from a 16-bit converter; the other half uses every bit.
            wave = np.round((wave + 1e-3 * rng.normal(size=count)) * 3276.8) / 3276.8
        rows[channel.name] = wave
    return Messages("noise", (NOISE,), list(calls({NOISE.name: rows})))


def run(count: int, seed: int, folder: Path) -> Messages:
    """Return the first rows of every stream of a simulated campaign, ``count`` in all."""
    recording = Recording.open(record("pvc", seed, folder))
    streams = tuple(recording.streams.values())
    each = count // len(streams)
    rows = {stream.name: recording.read(stream.name)[:each] for stream in streams}
    return Messages("run", streams, list(calls(rows)))


def calls(rows: dict[str, NDArray[np.void]]) -> Iterator[tuple[str, NDArray[np.void]]]:
    """Yield some rows of each stream after the other, as the recorder gets them."""
    for start in range(0, max(map(len, rows.values())), ROWS_PER_CALL):
        for name, of_stream in rows.items():
            yield name, of_stream[start : start + ROWS_PER_CALL]


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


@dataclass(frozen=True)
class Packed:
    """Messages as the library takes them: number of the stream, time in ns, payload."""

    messages: list[tuple[int, int, bytes]]

    @classmethod
    def of(cls, what: Messages) -> Packed:
        """Pack every row in the order of the calls."""
        numbers = {stream.name: number for number, stream in enumerate(what.streams)}
        return cls(
            [
                (numbers[name], t_ns, b"\x00\x01\x00\x00" + row.tobytes()[8:])
                for name, rows in what.calls
                for t_ns, row in zip(rows["t_ns"].tolist(), rows, strict=True)
            ]
        )


def write_library(path: Path, what: Messages, packed: Packed, how: Compression) -> None:
    with path.open("wb") as file, library_level(ZSTD_LEVEL):
        writer = Writer(file, compression=LIBRARY[how])
        writer.start("ros2", "benchmark")
        channels = []
        for stream in what.streams:
            text = schema_text(stream).encode()
            schema = writer.register_schema(f"rigd/msg/{stream.name}", "ros2msg", text)
            channels.append(writer.register_channel(f"/{stream.name}", "cdr", schema))
        for sequence, (number, t_ns, payload) in enumerate(packed.messages):
            writer.add_message(channels[number], t_ns, payload, t_ns, sequence)
        writer.finish()  # type: ignore[no-untyped-call]  # the library leaves it untyped
        file.flush()
        os.fdatasync(file.fileno())  # as closing a recording does


def write_rigd(path: Path, what: Messages, how: Compression) -> None:
    path.unlink(missing_ok=True)
    with RecordingWriter.create(
        path,
        streams=what.streams,
        metadata={},
        attachments=(),
        start_ns=int(what.calls[0][1]["t_ns"][0]),
        compression=how,
        sync_interval_s=None,
    ) as writer:
        for name, rows in what.calls:
            writer.write(name, rows)


def read_library(path: Path) -> int:
    """Read all messages in file order; joining their payloads is the least that makes columns."""
    with path.open("rb") as file:
        payloads: dict[int, list[bytes]] = {}
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            payloads.setdefault(channel.id, []).append(message.data)
        return sum(len(b"".join(messages)) for messages in payloads.values())


def read_rigd(path: Path) -> int:
    recording = Recording.open(path)
    return sum(recording.read(stream).nbytes for stream in recording.streams)


def cpu_us(action: Callable[[], object], messages: int) -> float:
    """Return the CPU time of all threads in µs per message: a median, the first not counted."""
    action()
    times: list[float] = []
    while not times or sum(times) < LEAST_S:
        before = time.process_time()
        action()
        times.append(time.process_time() - before)
    return statistics.median(times) * 1e6 / messages


def measure(what: Messages, rounds: int, folder: Path) -> list[Line]:
    """Return the lines of the table; library and rigd take turns within each round."""
    packed = Packed.of(what)
    taken: dict[tuple[str, Compression, str], list[float]] = {}
    theirs, ours = folder / "theirs.mcap", folder / "ours.mcap"
    for _, how in itertools.product(range(rounds), LIBRARY):
        pairs: list[tuple[str, str, Callable[[], object]]] = [
            ("write", "library", partial(write_library, theirs, what, packed, how)),
            ("write", "rigd", partial(write_rigd, ours, what, how)),
            ("read", "library", partial(read_library, theirs)),
            ("read", "rigd", partial(read_rigd, ours)),
        ]
        for action, library, function in pairs:
            taken.setdefault((action, how, library), []).append(cpu_us(function, what.count))
        check(what, ours)
    return [
        Line(
            f"{what.name}, {action} {how}",
            taken[action, how, "library"],
            taken[action, how, "rigd"],
            targets[how],
        )
        for action, targets in (("write", WRITE_TARGETS), ("read", READ_TARGETS))
        for how in LIBRARY
    ]


def check(what: Messages, path: Path) -> None:
    """Raise unless the recording has every row as it was given."""
    recording = Recording.open(path)
    for stream in what.streams:
        given = [rows for name, rows in what.calls if name == stream.name]
        assert recording.read(stream.name).tobytes() == np.concatenate(given).tobytes()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else None)
    parser.add_argument("--rows", type=int, default=200_000)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seed", type=int, default=time.time_ns() % 2**32)
    options = parser.parse_args()
    print(f"{options.rows} messages, {options.rounds} rounds, seed {options.seed}; ", end="")
    print("CPU in µs per message, medians")
    print(f"{'':18}{'mcap':>9}{'rigd':>9}{'ratio':>9}{'least':>9}{'most':>9}{'target':>9}")
    lines = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for what in (run(options.rows, options.seed, folder), noise(options.rows, options.seed)):
            lines += measure(what, options.rounds, folder)
    for line in lines:
        theirs, ours = statistics.median(line.library_us), statistics.median(line.rigd_us)
        low, middle, high = min(line.ratios), statistics.median(line.ratios), max(line.ratios)
        print(
            f"{line.name:18}{theirs:9.2f}{ours:9.3f}{middle:8.1f}x{low:8.1f}x{high:8.1f}x"
            f"{line.target:8.0f}x"
        )
    for line in lines:
        at_least(f"recording, {line.name}", statistics.median(line.ratios), line.target)


if __name__ == "__main__":
    main()
