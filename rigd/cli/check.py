"""``rigd check``: is this file right? Nothing is opened, nothing moves."""

from __future__ import annotations

import argparse
import json
import sys
from datetime import UTC, datetime
from pathlib import Path

HELP = "check rig, procedure and calibration files without running anything"
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
    parser.add_argument(
        "files", nargs="+", metavar="FILE", help="rig, procedure or calibration files"
    )
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
    from rigd.config.calibration import load_calibration
    from rigd.config.loader import load_rig
    from rigd.config.rig import RigConfig
    from rigd.config.shipped import find_file
    from rigd.evaluate.models import needs_of
    from rigd.procedure.compile import compile_procedure
    from rigd.procedure.loader import load_procedure

    kind = _kind(given)
    if kind == "calibration":
        calibration = load_calibration(Path(given))
        last = calibration.valid_until
        valid = "none expires" if last is None else f"all valid until {last}"
        if last is not None and last < datetime.now(UTC).date():
            valid = f"not all of them valid: the first expired on {last}"
        return f"calibration {calibration.name}, {len(calibration.values)} values, {valid}: right"
    if kind == "rig":
        checked = load_rig(given)
        if checked.plant is not None:
            checked.plant.plant_class.files(checked.plant.config)
        channels = sum(len(device.channels) for device in checked.devices.values())
        parts = [f"rig {checked.name}", f"{len(checked.devices)} devices", f"{channels} channels"]
        if checked.calibration is not None:
            held = checked.calibration.held
            if held is None:
                missing = f"right, but there is no calibration file {checked.calibration.path} yet"
                return f"{', '.join(parts)}: {missing}"
            parts.append(f"calibration {held.name}")
        return ", ".join(parts) + ": right"
    procedure = load_procedure(find_file(given, "procedures"))
    if not isinstance(rig, RigConfig):
        return "a procedure, right in itself; give --rig to check it against a rig"
    compiled = compile_procedure(procedure, rig, {})
    if compiled.identify is not None:
        needs_of(
            compiled.identify,
            procedure.document.key_place(("identify",)),
            compiled.trials[0].parameters,
            rig,
        )
    count = len(compiled.trials)
    trials = "1 trial" if count == 1 else f"{count} trials"
    return f"procedure {compiled.name}, {trials} on {rig.name}: right"


def _kind(given: str) -> str:
    """Return what ``given`` is by its own keys, or by a name that is no procedure's."""
    from rigd.config.shipped import find_file
    from rigd.model.errors import ConfigError

    path = Path(given)
    if not path.is_file():
        try:
            find_file(given, "procedures")
        except ConfigError as error:
            if path.suffix:
                raise ConfigError(f"there is no file {given!r}", hint=error.hint) from error
            return "rig"
        return "procedure"
    with path.open("rb") as stream:
        lines = stream.read(4096).decode("utf-8", errors="replace").splitlines()
    for kind in ("rig", "procedure", "calibration"):  # a rig file names its calibration too
        if any(line.startswith(f"{kind}:") for line in lines):
            return kind
    return "procedure"


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
