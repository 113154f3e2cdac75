"""Streams and rows that the tests of recording share."""

from __future__ import annotations

import math
import shutil
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.model import Channel, Stream
from rigd.model.rows import row_dtype
from rigd.record import Attachment, RecordingWriter

STRICT = Path(__file__).parent / "strict"
PACKAGES = Path(__file__).parents[2] / "node_modules" / ".cache" / "rigd-strict-mcap"


START_NS = 1_790_000_000_000_000_000

SERVO = Stream(
    "wheel_servo",
    (
        Channel("current", "A", "motor current", -10.0, 10.0),
        Channel("speed", "rad/s", "of the wheel\nnot the motor", 0.0, math.inf),
        Channel("counts", "count", raw_of="speed"),
    ),
    doc="drive of the wheel",
    has_status=True,
    source="sim-servo",
)
FORCE = Stream("force", (Channel("normal", "N"), Channel("tangential", "N")))
STREAMS = (SERVO, FORCE)

Rows = NDArray[np.void]


def make_rows(stream: Stream, count: int, *, seed: int = 1, rate_hz: float = 1000.0) -> Rows:
    rng = np.random.default_rng(seed)
    rows = np.zeros(count, row_dtype(stream))
    rows["t_ns"] = START_NS + (np.arange(count) * (1e9 / rate_hz)).astype(np.int64)
    for channel in stream.channels:
        rows[channel.name] = rng.normal(size=count)
    if stream.has_status:
        rows["status"] = rng.integers(0, 2**32, count)
    return rows


@pytest.fixture
def servo() -> Stream:
    return SERVO


@pytest.fixture
def force() -> Stream:
    return FORCE


@pytest.fixture
def start_ns() -> int:
    return START_NS


@pytest.fixture
def rows() -> Callable[..., Rows]:
    return make_rows


@pytest.fixture
def create(tmp_path: Path) -> Callable[..., RecordingWriter]:
    """Makes a writer of two streams; keywords go to ``RecordingWriter.create``."""

    def make(name: str = "run.mcap", **changes: Any) -> RecordingWriter:
        streams: Sequence[Stream] = changes.pop("streams", STREAMS)
        options: dict[str, Any] = {
            "metadata": {
                "run": {"procedure": "sweep", "rig": "bench", "mode": "simulated"},
                "parameters": {"torque": "0.15 A", "note": "µ and \u65e5"},
            },
            "attachments": (Attachment("rig.yaml", "application/yaml", b"name: bench\n"),),
            "start_ns": START_NS,
            "sync_interval_s": None,
            **changes,
        }
        return RecordingWriter.create(tmp_path / name, streams=streams, **options)

    return make


def need(program: str) -> str:
    found = shutil.which(program)
    if found is None:
        pytest.fail(
            f"{program} is missing, and without it no recording is checked by a reader of others:"
            " install Node.js 20 or later (apt-get install nodejs npm)"
        )
    return found


@pytest.fixture(scope="session")
def node_packages() -> tuple[str, Path]:
    """Return Node.js and the folder of the packages of Foxglove; install them at the first use."""
    node, npm = need("node"), need("npm")
    names = ("package.json", "package-lock.json")
    wanted = "".join((STRICT / name).read_text() for name in names)
    stamp = PACKAGES / "installed.json"
    if not stamp.exists() or stamp.read_text() != wanted:
        PACKAGES.mkdir(parents=True, exist_ok=True)
        for name in names:
            shutil.copyfile(STRICT / name, PACKAGES / name)
        command = [npm, "ci", "--no-audit", "--no-fund", "--ignore-scripts"]
        done = subprocess.run(command, cwd=PACKAGES, capture_output=True, text=True, check=False)
        if done.returncode:
            pytest.fail(f"npm cannot install the strict MCAP check:\n{done.stderr}")
        stamp.write_text(wanted)
    return node, PACKAGES
