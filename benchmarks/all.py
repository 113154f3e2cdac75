"""Runs every benchmark, one after the other, and ends with one table of all figures.

    make bench                      all of them, about 50 minutes
    python benchmarks/all.py plant recording

Wall time on a shared machine depends on its load: figures are ratios of runs interleaved with their
baseline, in CPU time if the peer allows it.

Studies of hours are no part of it and are started by hand: seeds, soak, identify_coverage,
identify_misfit, blind_lugre, design_promise and fault_campaign, each of which continues its table;
so are, of minutes, identify_fuzz, slip_filter, foreign_fmus and foreign_devices.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from figures import PREFIX

HERE = Path(__file__).parent
#: In the order to run; each prints its own table and `figure:` lines.
BENCHES = (
    "startup",
    "check",
    "plant",
    "mechanism",
    "articulated",
    "simulated_run",
    "derived",
    "controllers",
    "held_speed",
    "held_load",
    "computing_wire",
    "model_in_loop",
    "simulated_bus",
    "can_cycle",
    "modbus_codec",
    "register_card",
    "cycle",
    "card_blocks",
    "recording",
    "catalogue",
    "recorder",
    "importing",
    "foreign_recording",
    "live_feed",
    "remote_commands",
    "remote_load",
    "remote_fuzz",
    "stop_lane",
    "flood",
    "four_rigs",
    "panel",
    "page",
    "panel_stop",
    "panel_fuzz",
    "identify",
    "identify_speed",
    "validate_tables",
    "lateral_tables",
    "lateral_misfit",
    "robot_misfit",
    "angle_accuracy",
    "angle_campaign",
    "kill_table",
    "kill_moments",
    "can_starts",
    "automatic_stop",
    "conformance",
    "every_case",
)


def main() -> int:
    """Run the named benches, or all, and print what they found."""
    chosen = sys.argv[1:] or BENCHES
    rows: list[list[str]] = []
    failed = []
    for name in chosen:
        print(f"\n== {name}", flush=True)
        with subprocess.Popen(
            [sys.executable, str(HERE / f"{name}.py")], stdout=subprocess.PIPE, text=True
        ) as process:
            for line in process.stdout or ():
                if line.startswith(PREFIX):
                    rows.append([name, *(c.strip() for c in line[len(PREFIX) :].split("|"))])
                print(line, end="", flush=True)
        if process.returncode:
            failed.append(name)
    print("\n== figures")
    widths = [max(len(row[column]) for row in rows) for column in range(5)] if rows else []
    for row in rows:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)))
    for name in failed:
        print(f"{name} FAILED")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
