"""A disk that is full ends the recording with a clear error and without harm to what it has."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from rigd.record import Recording, recover

# RLIMIT_FSIZE makes the kernel itself write short and then refuse, as a full disk does. It
# cannot be lifted again for certain, hence a process of its own.
LIMITED = """
import json, resource, sys
from pathlib import Path
import numpy as np
from rigd.model import Channel, RecordingError, Stream
from rigd.model.rows import row_dtype
from rigd.record import RecordingWriter

path, limit = Path(sys.argv[1]), int(sys.argv[2])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
stream = Stream("fast", tuple(Channel(f"c{i}") for i in range(4)))
writer = RecordingWriter.create(
    path, streams=(stream,), metadata={}, attachments=(), start_ns=0, compression="none"
)
done, errors = 0, []
rng = np.random.default_rng(1)
for _ in range(100):
    rows = np.zeros(130, row_dtype(stream))
    rows["t_ns"] = np.arange(done, done + 130) * 1_000_000
    rows["c0"] = np.arange(done, done + 130)
    try:
        writer.write("fast", rows)
        writer.flush()
    except RecordingError as error:
        errors.append(str(error))
        if len(errors) == 3:
            break
        continue
    done += 130
writer.close()
writer.close()
print(json.dumps({"done": done, "errors": errors}))
"""


@pytest.mark.parametrize("limit", [60_000, 150_001, 200_000, 262_144, 330_003])
def test_flushed_rows_stay_readable(tmp_path: Path, limit: int) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", LIMITED, str(path), str(limit)]
    finished = subprocess.run(command, capture_output=True, text=True, check=True)
    result = json.loads(finished.stdout)
    assert len(set(result["errors"])) == 1  # the first cause, each time
    assert str(path) in result["errors"][0]
    assert "Free space" in result["errors"][0]
    read = Recording.open(path).read("fast")
    # All that was flushed; of the call that failed, what had been sealed by then may be there too.
    assert 0 < result["done"] <= len(read) < result["done"] + 130
    assert (read["c0"] == range(len(read))).all()
    assert recover(path).intact
    assert [item.name for item in tmp_path.iterdir()] == ["run.mcap"]


def test_no_room_at_the_start_leaves_no_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    command = [sys.executable, "-c", LIMITED, str(path), "100"]
    finished = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "RecordingError: cannot write" in finished.stderr
    assert not path.exists()
