"""A recording as another program writes it: by the `mcap` library, from `docs/recordings.md`."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any, Self

import numpy as np
from mcap.writer import Writer
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Recording:
    """Streams of float64 columns, and the events of trials; times in ns since the epoch."""

    def __init__(self, path: Path, begin: int, streams: dict[str, dict[str, str]]) -> None:
        self._file = path.open("wb")
        self._begin = begin
        self.writer = Writer(self._file)
        self.writer.start(profile="ros2", library="a logger")
        event = self.writer.register_schema(
            "rigd/msg/Event", "ros2msg", b"string kind\nint32 trial\nfloat64 time\nstring data\n"
        )
        self._events = self.writer.register_channel("/events", "cdr", event)
        self._streams = {name: self._register(name, units) for name, units in streams.items()}
        self._numbers = dict.fromkeys([self._events, *self._streams.values()], 0)

    def _register(self, name: str, units: dict[str, str]) -> int:
        doc = {
            "name": name,
            "doc": "samples of one card",
            "source": "a logger",
            "has_status": False,
            "channels": [
                {"name": n, "unit": u, "doc": "", "low": None, "high": None, "raw_of": None}
                for n, u in units.items()
            ],
        }
        schema = self.writer.register_schema(
            f"logger/msg/{name.title().replace('_', '')}",
            "ros2msg",
            "".join(f"float64 {channel}\n" for channel in units).encode(),
        )
        return self.writer.register_channel(
            f"/{name}", "cdr", schema, {"rigd.stream": json.dumps(doc)}
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def _add(self, which: int, when: int, data: bytes) -> None:
        self.writer.add_message(which, when, data, when, self._numbers[which])
        self._numbers[which] += 1

    def tell(self, kind: str, trial: int, when: int, data: dict[str, Any]) -> None:
        """Write an event."""
        text = bytearray(b"\x00\x01\x00\x00")
        _text(text, kind)
        text += b"\x00" * (-len(text) % 4)
        text += struct.pack("<i", trial)
        text += b"\x00" * (-(len(text) - 4) % 8)
        text += struct.pack("<d", (when - self._begin) * 1e-9)
        _text(text, json.dumps(data))
        self._add(self._events, when, bytes(text))

    def rows(self, tables: dict[str, tuple[NDArray[np.int64], Array]]) -> None:
        """Write rows of all streams, in the order of their times."""
        found = [
            (when, self._streams[name], row)
            for name, (times, table) in tables.items()
            for when, row in zip(times.tolist(), table.tolist(), strict=True)
        ]
        for when, channel, row in sorted(found, key=lambda item: item[0]):
            self._add(channel, when, b"\x00\x01\x00\x00" + struct.pack(f"<{len(row)}d", *row))

    def end(self, when: int, trials: int, about: dict[str, dict[str, str]]) -> None:
        """Write the end of the run and all metadata."""
        self.tell(
            "run_end",
            -1,
            when,
            {
                "state": "complete",
                "reason": "",
                "trials_done": trials,
                "trials_total": trials,
                "missed_cycles": 0,
                "overruns": 0,
            },
        )
        self.writer.add_metadata("rigd", {"start_ns": str(self._begin), "version": "0.1.0"})
        for name, values in about.items():
            self.writer.add_metadata(name, values)


def _text(text: bytearray, value: str) -> None:
    text += b"\x00" * (-(len(text) - 4) % 4)
    data = value.encode() + b"\x00"
    text += struct.pack("<I", len(data)) + data
