"""Kills the recorder process at random times while another process pushes rows, and counts.

The rows of eight streams of six channels at 1 kHz are numbered: afterwards each must be in the
recording exactly once. Half of the kills are SIGKILL; half stop the recorder (SIGSTOP) for the
daemon to replace. Also measured: what a push costs the cycle, the share of a core that the
recorder takes, and how long no recorder runs after a kill.

    python benchmarks/recorder.py --kills 50
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from figures import at_most, noted

from rigd.engine.recorder import RecorderProcess
from rigd.engine.shared import Job, Phase, RunFolder, Word
from rigd.model import Channel, Stream
from rigd.record import Recording

STREAMS = tuple(
    Stream(f"device{i}", tuple(Channel(f"c{j}") for j in range(6)), has_status=True)
    for i in range(8)
)
START_NS = 1_790_000_000_000_000_000
#: A minute at 1 kHz.
CAPACITY = 60_000
TICKS = os.sysconf("SC_CLK_TCK")

#: Stands for the cycle; prints the median cost of pushing one row, ns.
WRITER = """
import signal, sys, time
from pathlib import Path
from rigd.engine.shared import RunFolder

folder = RunFolder.at(Path(sys.argv[1]))
board, job = folder.board(), folder.job
rings = list(folder.row_rings(job).values())
n, due, costs = 0, time.monotonic_ns(), []
stop = []
signal.signal(signal.SIGTERM, lambda *_: stop.append(True))
while not stop:
    due += 1_000_000
    time.sleep(max(due - time.monotonic_ns(), 0) * 1e-9)
    row = (float(n), 0.1, 0.2, 0.3, 0.4, 0.5, n & 7)
    began = time.perf_counter_ns()
    for ring in rings:
        ring.push(job.start_ns + n * 1_000_000, row)
    costs.append(time.perf_counter_ns() - began)
    n += 1
print(sorted(costs)[len(costs) // 2] / len(rings))
"""


def cpu_s(pid: int) -> float:
    """Return the CPU time that a process has used, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def main() -> int:
    """Kill, check that nothing is lost, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=None)
    args = parser.parse_args()
    draw = random.Random(args.seed)
    with tempfile.TemporaryDirectory() as disk:
        path = Path(disk) / "run.mcap"
        folder = RunFolder.take("bench-recorder", command="benchmarks/recorder.py")
        job = Job("bench-recorder", path, STREAMS, START_NS)
        folder.prepare(job, {stream.name: CAPACITY for stream in STREAMS})
        board, rings = folder.board(), folder.row_rings(job)
        recorder = RecorderProcess(folder)
        recorder.start()
        recorder.wait_until_recording()
        command = [sys.executable, "-c", WRITER, str(folder.path)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as writer:
            used_s, began_s = cpu_s(recorder.pid), time.monotonic()
            time.sleep(5.0)
            share = (cpu_s(recorder.pid) - used_s) / (time.monotonic() - began_s)
            outages_ms = []
            for number in range(args.kills):
                time.sleep(draw.uniform(0.0, 0.2))
                killed_s = time.monotonic()
                os.kill(recorder.pid, signal.SIGSTOP if number % 2 else signal.SIGKILL)
                recorder.restart()
                recorder.wait_until_recording()
                outages_ms.append((time.monotonic() - killed_s) * 1e3)
            writer.terminate()
            push_ns = float(writer.communicate()[0])
        board[Word.PHASE] = Phase.ENDED
        recorder.finish()
        shutil.rmtree(folder.path)
        folder.release()
        recording = Recording.open(path)
        wrong = overruns = rows = 0
        for name, ring in rings.items():
            there = recording.read(name)["c0"]
            wrong += not np.array_equal(there, np.arange(ring.head))
            overruns += ring.overruns
            rows += ring.head
    print(f"{rows} rows, {args.kills} kills")
    noted("one row pushed, p50", push_ns, "ns")
    noted("recorder at 8 streams of 1 kHz, share of a core", 100 * share, "%")
    noted("no recorder after a kill, p50", statistics.median(outages_ms), "ms")
    noted("no recorder after a kill, longest", max(outages_ms), "ms")
    at_most("streams with a row lost or doubled", wrong, 0, "of 8")
    at_most("rows lost to a full ring", overruns, 0, "")
    return 1 if wrong or overruns else 0


if __name__ == "__main__":
    sys.exit(main())
