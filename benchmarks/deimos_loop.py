"""The control loop of Deimos (deimos-daq on PyPI) on its own simulated card, for other benches.

    python deimos_loop.py FOLDER RATE_HZ SECONDS performant|efficient PRIORITY [GROUPS]

After its own example for software in place of hardware (`hootl`): one DAQ over UDP, a CSV file as
the recorder. As in rigd's run, a Python thread keeps the interpreter busy, and the newest row is
read 20 times a second. Prints a line of JSON. Runs in an environment of its own, and needs nothing
else but the standard library.

A cycle of Deimos begins ``period - ctrl.cycle_time_margin_ns`` late. None is skipped: those that
are late follow one another at once, unmarked. A row whose card has not answered since the one
before counts in ``loss_of_contact_counter``. PRIORITY is that of its control thread (SCHED_FIFO),
which Deimos itself leaves at 0. GROUPS are those of four computed channels each, in its calc graph:
an input through a Butterworth low-pass of second order, a line, a parabola and a line again.
"""

from __future__ import annotations

import csv
import json
import os
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from deimos import (  # type: ignore[import-not-found]  # in an environment of its own
    Controller,
    LoopMethod,
    Overflow,
    Termination,
    calc,
    dispatcher,
    peripheral,
    socket,
)

VIEWS_HZ = 20.0
#: Mock and controller lose each other at once at 1 kHz with their own 10 packets.
PATIENCE_CYCLES = 5000
CSV_MB = 2000
MARGIN, UNANSWERED = "ctrl.cycle_time_margin_ns", "card.metrics.loss_of_contact_counter"


def controller(folder: Path, rate_hz: float, seconds: float, method: str, groups: int) -> Any:
    """Return a controller with one card, recording to a CSV file."""
    made = Controller(op_name="loop", op_dir=str(folder), rate_hz=rate_hz)
    made.termination_criteria = Termination.timeout_s(seconds)
    made.loop_method = getattr(LoopMethod, method)()
    made.peripheral_loss_of_contact_limit = PATIENCE_CYCLES
    made.controller_loss_of_contact_limit = PATIENCE_CYCLES
    made.clear_sockets()
    made.add_socket("udp", socket.UdpSocket())
    made.add_dispatcher("csv", dispatcher.CsvDispatcher(CSV_MB, Overflow.new_file()))
    made.add_peripheral("card", peripheral.DeimosDaqRev6(1))
    for n in range(groups):
        made.add_calc(f"low{n}", calc.Butter2("card.ain0", 50.0 + n))
        made.add_calc(f"scaled{n}", calc.Affine(f"low{n}.y", 2.0, 1.0))
        made.add_calc(f"curve{n}", calc.Polynomial(f"scaled{n}.y", [0.1, 0.2, 0.3], ""))
        made.add_calc(f"back{n}", calc.InverseAffine(f"curve{n}.y", 2.0, 1.0))
    return made


def busy(over: threading.Event) -> None:
    """Compute and never wait."""
    while not over.is_set():
        sum(range(2000))


def threads_cpu() -> dict[str, float]:
    """Return the CPU time of this process's threads, s, by name."""
    used: dict[str, float] = {}
    for task in Path("/proc/self/task").iterdir():
        spent_ns = int((task / "schedstat").read_text().split()[0])
        name = (task / "comm").read_text().strip()
        used[name] = used.get(name, 0.0) + 1e-9 * spent_ns
    return used


def control_thread() -> int:
    """Return the number of the thread that runs the loop."""
    tasks = Path("/proc/self/task").iterdir()
    return next(
        int(task.name) for task in tasks if (task / "comm").read_text() == "controller-run\n"
    )


def main() -> None:
    """Run, then read what was recorded."""
    folder, rate_hz, seconds = Path(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
    groups = int(sys.argv[6]) if len(sys.argv) > 6 else 0
    made = controller(folder, rate_hz, seconds, sys.argv[4], groups)
    over = threading.Event()
    with made.attach_hootl_driver("card", peripheral.HootlTransport.udp()):
        handle = made.run_nonblocking()
        if priority := int(sys.argv[5]):
            os.sched_setscheduler(control_thread(), os.SCHED_FIFO, os.sched_param(priority))
        print("running", flush=True)
        threading.Thread(target=busy, args=(over,)).start()
        used: dict[str, float] = {}
        try:
            while handle.is_running():
                handle.latest_row()
                with suppress(FileNotFoundError, ProcessLookupError):  # threads end with the loop
                    for name, spent_s in threads_cpu().items():
                        used[name] = max(spent_s, used.get(name, 0.0))
                time.sleep(1 / VIEWS_HZ)
            handle.join()
        finally:
            over.set()
    late_us, unanswered = [], 0
    with (folder / "loop.csv").open(newline="") as file:
        rows = csv.DictReader(file)
        computed = [name for name in rows.fieldnames or () if name.startswith("back")]
        if len(computed) != groups:
            raise SystemExit(f"Deimos has recorded {computed}, expected {groups} groups")
        for row in rows:
            late_us.append(1e6 / rate_hz - float(row[MARGIN]) * 1e-3)
            unanswered += float(row[UNANSWERED]) > 0
    found = {"late_us": late_us, "unanswered": unanswered, "cpu_s": used}
    print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
