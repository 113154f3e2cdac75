"""An NI card at 9600 Hz × 4 inputs through the helper process, against nidaqmx read bare.

The card is the simulated one behind its gRPC server, in a process of its own. By turns: a bare
loop that reads with nidaqmx and throws away, and rigd's helper, which converts, stamps, and puts
every row into a ring and the newest into the table that the cycle reads. CPU time is that of the
reading process, from /proc; ages are those of the newest row when it is seen in the table.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from figures import at_least, at_most, noted

from rigd.config.loader import parse_rig
from rigd.config.rig import DeviceConfig
from rigd.engine.shared import RowRing
from rigd.engine.slow.block_helper import BlockHelper
from rigd.engine.slow.table import LatestTable, Slot

RATE_HZ, INPUTS, BLOCK = 9600.0, 4, 96
ROUNDS, SECONDS, SETTLE_S = 3, 8.0, 1.0
LOOK_S = 0.001

RIG = """
rig: card
title: one NI card
cycle: 1 kHz
interlocks: []
devices:
  daq:
    driver: ni-daq
    options:
      server: 127.0.0.1:{port}
      rate: {rate} Hz
      block: {block}
      inputs: [{inputs}]
"""


def serve() -> None:
    """Serve the simulated card until killed; print its port."""
    from rigd_sim.wire.cards.ni import SimNi

    async def run() -> None:
        part = SimNi("daq", {f"ai{index}": (lambda: 1.0) for index in range(INPUTS)})
        await part.start()
        print(part.port, flush=True)
        await asyncio.Event().wait()

    asyncio.run(run())


def read_bare(port: str) -> None:
    """Read blocks with nidaqmx and throw them away, until killed."""
    import grpc
    import nidaqmx
    from nidaqmx.constants import AcquisitionType
    from nidaqmx.stream_readers import AnalogMultiChannelReader

    options = nidaqmx.GrpcSessionOptions(grpc.insecure_channel(f"127.0.0.1:{port}"), "bare")
    task = nidaqmx.Task("bare", grpc_options=options)
    for index in range(INPUTS):
        task.ai_channels.add_ai_voltage_chan(f"Dev1/ai{index}", min_val=-10, max_val=10)
    task.timing.cfg_samp_clk_timing(
        RATE_HZ, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=int(5 * RATE_HZ)
    )
    reader = AnalogMultiChannelReader(task.in_stream)
    reader.verify_array_shape = False
    data = np.zeros((INPUTS, BLOCK))
    task.start()
    print("started", flush=True)
    while True:
        reader.read_many_sample(data, BLOCK, 10.0)


def cpu_s(pid: int) -> float:
    """Return the CPU time that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def share(pid: int, wait_s: float = SECONDS) -> float:
    """Return the share of a core that a process uses in the next ``wait_s``, in %."""
    before, began = cpu_s(pid), time.monotonic()
    time.sleep(wait_s)
    return 100 * (cpu_s(pid) - before) / (time.monotonic() - began)


@contextmanager
def role(*arguments: str) -> Iterator[tuple[int, str]]:
    """Run this file in another role; yield process id and first line, and kill it in the end."""
    command = [sys.executable, __file__, *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.pid, process.stdout.readline().strip()
        finally:
            process.kill()


def bare_share() -> float:
    """Return the share of a core of the bare loop, in %."""
    with role("serve") as (_, port), role("bare", port) as (reader, _):
        time.sleep(SETTLE_S)
        return share(reader)


def device_at(port: str) -> DeviceConfig:
    """Return the card at ``port`` as a rig file gives it."""
    inputs = ", ".join(f"{{name: input_{i}, channel: ai{i}}}" for i in range(INPUTS))
    text = RIG.format(port=port, rate=RATE_HZ, block=BLOCK, inputs=inputs)
    return parse_rig(text, Path("card.yaml")).devices["daq"]


def helper_share(folder: Path) -> tuple[float, int, list[float]]:
    """Return the share of a core of the helper in %, samples lost, and ages of rows in ms."""
    with role("serve") as (_, port):
        device = device_at(port)
        ring = RowRing.create(folder / "ring", device.stream, int(60 * RATE_HZ))
        slot = LatestTable.create(folder / "table", [device.stream]).slot("daq")
        helper = BlockHelper(
            device, ring=folder / "ring", table=folder / "table", table_streams=[device.stream],
            start_ns=0, origin_ns=0, log=folder / "log",
        )  # fmt: skip
        helper.start()
        time.sleep(SETTLE_S)
        found = share(helper.pid)
        ages = row_ages(slot)
        if helper.poll() is not None:
            raise SystemExit(helper.poll())
        helper.stop()
    numbers = np.rint(ring.drain()["device_time"] * RATE_HZ)
    return found, ring.overruns + int(numbers[-1] + 1 - len(np.unique(numbers))), ages


def row_ages(slot: Slot) -> list[float]:
    """Look every ms for 2 s; return how old each new row is when it is seen, in ms."""
    ages, seen, end = [], slot.sequence, time.monotonic() + 2.0
    while time.monotonic() < end:
        time.sleep(LOOK_S)
        found = slot.read() if slot.sequence != seen else None
        if found is not None:
            seen = slot.sequence
            ages.append((time.monotonic_ns() - found[0]) * 1e-6)
    return ages


def main() -> None:
    """Measure by turns and print the figures."""
    bare, helped, lost, ages = [], [], 0, []
    for _ in range(ROUNDS):
        bare.append(bare_share())
        with tempfile.TemporaryDirectory() as folder:
            used, missing, old = helper_share(Path(folder))
        helped.append(used)
        lost += missing
        ages += old
        print(f"bare {bare[-1]:5.1f} %   helper {used:5.1f} %   lost {missing}", flush=True)
    at_most("samples lost", lost, 0, "")
    noted("CPU of the helper", statistics.median(helped), "% of a core")
    noted("helper / bare nidaqmx loop", statistics.median(helped) / statistics.median(bare), "x")
    noted("age of the newest row, p50", float(np.percentile(ages, 50)), "ms")
    noted("age of the newest row, p99", float(np.percentile(ages, 99)), "ms")
    at_least("rows looked at", len(ages), 100 * ROUNDS, "")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["serve"]:
            serve()
        case ["bare", port]:
            read_bare(port)
        case _:
            main()
