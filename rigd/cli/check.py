"""``rigd check``: is this file right? Nothing is opened, nothing moves."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

HELP = "check rig and procedure files without running anything"
EXAMPLES = """\
examples:
  rigd check configs/sim_lugre.yaml
  rigd check procedures/*.yaml --rig lugre-1     also names, units and limits against the rig

  Without --rig only the keys of a procedure and their shapes are checked: names, units and
  expressions mean something on a rig.
  Exit code 0: every file is right; 2: at least one is not.
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("files", nargs="+", metavar="FILE", help="rig or procedure files")
    parser.add_argument("--rig", metavar="RIG", help="rig to check procedures against")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")


def execute(args: argparse.Namespace) -> int:
    """Check every file; one that is wrong never keeps the others from being checked."""
    from rigd.config.loader import load_rig
    from rigd.config.rig import RigConfig
    from rigd.model.errors import ConfigError, Exit

    rig: RigConfig | None = None if args.rig is None else load_rig(args.rig)
    reports: list[tuple[str, str, ConfigError | None]] = []
    for given in args.files:
        try:
            reports.append((given, _check(given, rig), None))
        except ConfigError as error:
            reports.append((given, "", error))
    if args.json:
        print(json.dumps([_as_json(*report) for report in reports], indent=2))
    else:
        for given, summary, problem in reports:
            if problem is None:
                print(f"{given}: {summary}")
            else:
                print(f"rigd: {problem}", file=sys.stderr)
    wrong = any(problem is not None for _, _, problem in reports)
    return int(Exit.BAD_INPUT if wrong else Exit.OK)


def _check(given: str, rig: object) -> str:
    """Return what a right file is; which kind it is stands in its first key."""
    from rigd.config.loader import load_rig
    from rigd.config.rig import RigConfig
    from rigd.config.shipped import find_file
    from rigd.evaluate.models import needs_of
    from rigd.procedure.compile import compile_procedure
    from rigd.procedure.loader import load_procedure

    if _is_rig(given):
        checked = load_rig(given)
        if checked.plant is not None:
            checked.plant.plant_class.files(checked.plant.config)
        channels = sum(len(device.channels) for device in checked.devices.values())
        return f"rig {checked.name}, {len(checked.devices)} devices, {channels} channels: right"
    procedure = load_procedure(find_file(given, "procedures"))
    if not isinstance(rig, RigConfig):
        return "a procedure, right in itself; give --rig to check it against a rig"
    compiled = compile_procedure(procedure, rig, {})
    if compiled.identify is not None:
        needs_of(
            compiled.identify,
            procedure.document.key_place(("identify",)),
            compiled.trials[0].parameters,
        )
    count = len(compiled.trials)
    trials = "1 trial" if count == 1 else f"{count} trials"
    return f"procedure {compiled.name}, {trials} on {rig.name}: right"


def _is_rig(given: str) -> bool:
    """Return whether a file's own first key, or a name that is no procedure's, says rig."""
    from rigd.config.shipped import find_file
    from rigd.model.errors import ConfigError

    path = Path(given)
    if not path.is_file():
        try:
            find_file(given, "procedures")
        except ConfigError as error:
            if path.suffix:
                raise ConfigError(f"there is no file {given!r}", hint=error.hint) from error
            return True
        return False
    with path.open("rb") as stream:
        lines = stream.read(4096).decode("utf-8", errors="replace").splitlines()
    return any(line.startswith("rig:") for line in lines)


def _as_json(given: str, summary: str, error: Exception | None) -> dict[str, object]:
    from rigd.model.errors import ConfigError

    if not isinstance(error, ConfigError):
        return {"file": given, "right": True, "summary": summary}
    problems = [
        {
            "message": one.message,
            "hint": one.hint,
            "line": None if one.place is None else one.place.line,
            "column": None if one.place is None else one.place.column,
        }
        for one in (error, *error.others)
    ]
    return {"file": given, "right": False, "problems": problems}
