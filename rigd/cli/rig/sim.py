"""``rigd sim``: simulates the devices of a rig at their connections (the wire).

The rig file must have a simulation.
"""

from __future__ import annotations

import argparse
import gc
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from rigd.cli.views.output import outlive_output

HELP = "serve the simulated devices of a rig behind real connections"
EXAMPLES = """\
examples:
  rigd sim configs/wire_lugre.yaml
  rigd sim wire-1 --faults my_faults.yaml
                            my_faults.yaml lists which device fails, how and when:
                              faults:
                                - {part: wheel_servo, fault: silent, at: 10 s, for: 1 s}
  rigd sim wire-1 --profile wheel_servo=maxon-epos4
                            the wheel's drive has the identity, objects and units of that make

  The command serves until Ctrl-C. In another terminal: rigd run procedures/quick.yaml --rig wire-1
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("rig", metavar="RIG", help="rig file, or the name in it (wire-1)")
    parser.add_argument("--faults", type=Path, metavar="FILE", help="file of faults to simulate")
    parser.add_argument(
        "--profile",
        action="append",
        default=[],
        metavar="[DEVICE=]MAKE",
        help="make of a simulated drive, or of all (elmo-gold, maxon-epos4); may be repeated",
    )


def execute(args: argparse.Namespace) -> int:
    """Serve until a signal; print a line per device when all are reachable."""
    from rigd.model.machine.system import require_linux

    require_linux("`rigd sim`")
    from rigd.config.loader import load_rig
    from rigd.config.shipped_files import titled
    from rigd.engine.system.realtime import SIMULATED_PRIORITY, RealTime
    from rigd.model.errors import ConfigError, Exit

    outlive_output()
    rig = load_rig(args.rig)
    print(f"rig {titled(rig.name, rig.source.location)}", file=sys.stderr)
    if rig.simulation is None:
        raise ConfigError(
            f"rig {rig.name} has no simulation at the wire",
            hint="configs/wire_lugre.yaml has a simulation at the wire, under `simulation:`; "
            "a rig with a `plant:` is simulated in process and needs no `rigd sim`",
        )
    setup = rig.simulation
    makes = {name: make for name, _, make in (item.rpartition("=") for item in args.profile)}
    try:
        config = setup.simulation_class.of_makes(setup.config, makes) if makes else setup.config
    except ValueError as error:
        raise ConfigError(
            f"--profile: {error}",
            hint="`--profile DEVICE=MAKE` is for one device, `--profile MAKE` for every drive",
        ) from error
    stopped = False

    def stop(*_: object) -> None:
        nonlocal stopped
        stopped = True

    def started(lines: Sequence[str]) -> None:
        gc.collect()
        gc.freeze()  # collecting all imported objects would stall every device for 0.1 s
        print(*lines, f"rig {rig.name} is served; Ctrl-C ends it", sep="\n", flush=True)

    # Signals are handled from here on, also while the simulation starts.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, stop)
    # Before any thread starts, so that threads inherit it.
    RealTime().schedule(SIMULATED_PRIORITY)
    simulation = setup.simulation_class(config)
    simulation.serve(started, lambda: stopped, args.faults)
    return int(Exit.OK)
