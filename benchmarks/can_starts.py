"""How often a rig opens, drives and stops beside foreign frames on its CAN buses and busy programs.

The rig is the shipped one at the wire with a CiA 404 transmitter and a sensor of a DBC file: every
CAN driver. Each start is `rigd run` of a movement of a second. Prints how it ended.

    python benchmarks/can_starts.py --starts 20
    python benchmarks/can_starts.py --starts 20 --foreign 0 --idle
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

from figures import at_least, noted

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.can.foreign import foreign_traffic, hogs
from support.faults.killing import SHAKING, own_state
from support.faults.rigs import sensors_rig
from support.wire import WireRig

BUSES = ("servo_bus", "encoder_bus")
#: A run takes some seconds; one that hangs ends after this.
LIMIT_S = 120.0


def one_start(rig: WireRig, folder: Path) -> tuple[int | None, str]:
    """Run the rig once; return the exit code, and the last words if it is not 0."""
    place = Path(tempfile.mkdtemp(dir=folder))
    state = own_state(place)
    procedure = place / "shake.yaml"
    procedure.write_text(SHAKING.procedure.replace("for: 7200 s", "for: 1 s"))
    try:
        done = subprocess.run(
            [
                *(sys.executable, "-m", "rigd", "run", str(procedure), "--yes"),
                *("--rig", str(rig.rig), "--output", str(place / "run.mcap")),
            ],
            env={**os.environ, "RIGD_STATE": str(state)}, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=LIMIT_S, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None, "did not end"
    finally:
        shutil.rmtree(state, ignore_errors=True)
        shutil.rmtree(place, ignore_errors=True)
    return done.returncode, "" if done.returncode == 0 else done.stdout.decode()[-1500:]


def main() -> int:
    """Start the rig again and again, and print what became of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--starts", type=int, default=20)
    parser.add_argument("--foreign", type=float, default=1000.0, help="frames/s on each bus")
    parser.add_argument("--idle", action="store_true", help="without a busy process per processor")
    args = parser.parse_args()
    well = opened = 0
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        rig = stack.enter_context(sensors_rig(folder))
        buses = [rig.folder / name for name in BUSES]
        stack.enter_context(foreign_traffic(buses, args.foreign))
        if not args.idle:
            stack.enter_context(hogs())
        for number in range(args.starts):
            code, told = one_start(rig, folder)
            well += code == 0
            opened += code != 3
            print(f"{number + 1}/{args.starts} exit {code} {told}", flush=True)
    noted("starts beside foreign frames, opened", opened, f"of {args.starts}")
    at_least("starts beside foreign frames, ran to the end", well, args.starts, "")
    return 0 if well == args.starts else 1


if __name__ == "__main__":
    sys.exit(main())
