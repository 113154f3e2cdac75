"""Streams of numbered rows, and what a recording of them must hold."""

from __future__ import annotations

from pathlib import Path

from rigd.model import Channel, Stream
from rigd.record import Recording, recover

START_NS = 1_790_000_000_000_000_000
STREAMS = (
    Stream("fast", tuple(Channel(f"c{i}") for i in range(4))),
    Stream("slow", (Channel("c0"),), has_status=True),
    Stream("block", (Channel("c0"), Channel("c1"))),
)
CAPACITIES = {"fast": 30_000, "slow": 3_000, "block": 30_000}


def check_numbered(path: Path, counts: dict[str, int]) -> None:
    """The recording is sound, and has rows 0 to count - 1 of each stream, each exactly once."""
    assert recover(path).intact
    recording = Recording.open(path)
    for name, count in counts.items():
        assert recording.read(name)["c0"].tolist() == list(range(count)), name


def own_events(path: Path, kind: str) -> list[int]:
    """The numbers of the events of a kind, in the order of the file."""
    return [event.data["n"] for event in Recording.open(path).events() if event.kind == kind]
