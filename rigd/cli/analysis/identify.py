"""``rigd identify``: computes friction parameters with uncertainties, and makes a report.

The input is one or several recordings.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rigd.cli.analysis.evaluation import add_evaluated, one_thread, read_corrections, show

HELP = "identify friction parameters from recordings, and write a report"
EXAMPLES = """\
examples:
  rigd identify runs/20261121-080000-constant_current-pvc.mcap
  rigd identify runs/*constant_current*.mcap       one report on all floors
  rigd identify FILE --figures figures/            each figure as SVG, PDF and CSV (data)
  rigd identify FILE --json                        for a program
  rigd identify before.mcap after.mcap --group-by recording
  rigd identify runs/*approach_angles*.mcap        one campaign from several files
  rigd identify FILE --joint                       floors and masses in one fit
  rigd identify FILE --method slip-force           without simulating the rig
  rigd identify LATERAL --model MODEL.json         friction along the guide as known
  rigd identify FILE --compare                     which friction law the data support
  rigd identify FILE --law lugre-4                 the parameters of another law
  rigd identify FILE --calibration new.yaml        raw volts under another calibration
  rigd identify FILE --set wheel_radius="50 mm"    not the recorded constant
  rigd identify FILE --plan constant_current       the constants of that procedure

  A parameter that the data do not determine is marked so, with the excitation that would help.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="recordings")
    parser.add_argument(
        "--starts", type=int, default=8, metavar="N", help="number of starts of the fit (default 8)"
    )
    parser.add_argument(
        "--seed", type=int, default=1, metavar="N", help="seed of the random starts (default 1)"
    )
    parser.add_argument(
        "--robust", action="store_true", help="Huber loss instead of least squares, for outliers"
    )
    parser.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        help="convert the raw volts with this calibration, not with the recordings' own",
    )
    parser.add_argument(
        "--group-by",
        choices=["recording"],
        help="identify each recording separately, to compare them",
    )
    parser.add_argument(
        "--method",
        choices=["slip-force", "output-error"],
        default="",
        help=(
            "estimation method: simulate the rig and compare its outputs (default, if the "
            "constants of the drive are known); or slip in, traction out"
        ),
    )
    parser.add_argument(
        "--joint",
        action="store_true",
        help=("groups share the constants of the rig, and masses on one floor their friction"),
    )
    parser.add_argument(
        "--law",
        default="",
        metavar="NAME",
        help="fit this friction law, not the default; an unknown name lists those installed",
    )
    parser.add_argument(
        "--compare",
        action="store_true",
        help="say which of the installed friction laws the data support",
    )
    parser.add_argument(
        "--model",
        type=Path,
        metavar="MODEL",
        help="of a lateral sweep: the friction along the guide, as `rigd identify --json` wrote it",
    )
    add_evaluated(parser)


def execute(args: argparse.Namespace) -> int:
    """Identify, write the report, print the results."""
    from rigd.model.machine.extras import require

    require("analysis", "rigd identify")
    one_thread()

    from rigd.analysis.analysis import Options
    from rigd.analysis.api import identified
    from rigd.analysis.side_by_side import cores
    from rigd.model.errors import Exit

    corrections = read_corrections(args)
    by_recording = args.group_by is not None
    options = Options(
        args.starts, args.seed, args.robust, args.calibration, by_recording, args.method,
        args.law, args.compare, args.joint, cores(), args.model,
    )  # fmt: skip
    result = identified(
        args.files,
        options,
        corrections,
        notify=lambda line: print(f"identifying {line}", file=sys.stderr),
    )
    show(args, result, args.files[0].with_suffix(".html"))
    return Exit.OK if result.fits else Exit.MISFIT
