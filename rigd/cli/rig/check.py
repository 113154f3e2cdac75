"""``rigd check``: checks rig files and procedures; opens no device and moves nothing."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from difflib import SequenceMatcher
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigd.cli.options import add_json, add_rig

if TYPE_CHECKING:
    from rigd.config.lab.lab import Specimen
    from rigd.config.rig import RigConfig
    from rigd.model.errors import ConfigError
    from rigd.procedure.program import CompiledProcedure
    from rigd.sdk.shipped_files import Kind

#: Names that are less alike are no typing errors of each other (share of equal letters).
_NEAR: Final = 0.75
#: Folders of shipped files that a name or path may mean, and what they hold.
_SHIPPED: Final[tuple[tuple[Kind, str], ...]] = (("procedures", "procedure"), ("configs", "rig"))

HELP = "check rig, procedure, calibration, lab and specimen files without running anything"
EXAMPLES = """\
examples:
  rigd check configs/sim_lugre.yaml
  rigd check procedures/*.yaml --rig lugre-1     also names, units and limits against the rig

  Without --rig a procedure is checked against the rig that RIGD_RIG or default_rig in rigd.yaml
  names, or else its own try_on. Without any only its keys and their shapes are checked: names,
  units and expressions can only be checked against a rig.

  A procedure is for another rig if its only errors are devices that the rig lacks, or channels
  and it is right on a shipped rig. With several procedures this is allowed: a line names each of
  them. If no procedure fits the rig, that is an error.

exit code: 0 every file is right, or a procedure for another rig beside one that fits; 2 otherwise
"""


@dataclass(frozen=True)
class FileReport:
    """The result for one file: ``summary``, or the ``problem`` if there is one.

    ``missing`` lists the devices or channels that the rig lacks, if nothing else is wrong.
    """

    given: str
    kind: str
    summary: str = ""
    problem: ConfigError | None = None
    missing: tuple[str, ...] = ()


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        help="rig, procedure, calibration, lab or specimen files",
    )
    add_rig(parser, "rig to check procedures against")
    add_json(parser)


def execute(args: argparse.Namespace) -> int:
    """Check every file; a wrong file does not stop the check of the others."""
    from rigd.config.loader import load_rig
    from rigd.config.shipped_files import titled
    from rigd.config.sibling.stated_rig import ChosenRig, stated_rig
    from rigd.model.errors import Exit

    stated = ChosenRig(args.rig) if args.rig is not None else stated_rig()
    rig = None if stated is None else load_rig(stated.rig)
    if (
        rig is not None
        and rig.source.location not in ("shipped", args.rig)
        and args.rig
        and not args.json
    ):
        print(f"rig {titled(rig.name, rig.source.location)}")
    reports = [_report(given, rig) for given in args.files]
    if stated is not None and stated.why and any(item.kind == "procedure" for item in reports):
        print(stated.why, file=sys.stderr)
    if args.json:
        print(json.dumps([_as_json(report) for report in reports], indent=2))
    else:
        _show(reports, rig)
    return int(Exit.OK if _is_right(reports) else Exit.BAD_INPUT)


def _report(given: str, rig: RigConfig | None) -> FileReport:
    from rigd.config.loader import load_rig
    from rigd.model.errors import ConfigError, OtherRigError

    kind = ""
    try:
        kind = _kind(given)
        on = rig
        if on is None and kind == "procedure":
            from rigd.procedure.chosen_rig import try_rig  # no other file loads procedures

            chosen = try_rig(given)
            on = None if chosen is None else load_rig(chosen.rig)
        return FileReport(given, kind, summary=_check(given, kind, on))
    except OtherRigError as error:
        missing = () if rig is None else error.missing
        return FileReport(given, kind, problem=error, missing=missing)
    except ConfigError as error:
        missing = () if rig is None or kind != "procedure" else _lacked(given, error, rig)
        return FileReport(given, kind, problem=error, missing=missing)


def _lacked(given: str, error: ConfigError, rig: RigConfig) -> tuple[str, ...]:
    """Return the channels that devices of ``rig`` lack, if it is right on a shipped rig.

    A misspelled channel is one that no rig has.
    """
    from rigd.config.loader import load_rig
    from rigd.model.errors import ConfigError
    from rigd.sdk.shipped_files import shipped_folder

    missing = {item.lacks for item in (error, *error.others)}
    if any(name.partition(".")[0] not in rig.devices for name in missing):
        return ()
    for file in sorted(shipped_folder("configs").glob("*.yaml")):
        with suppress(ConfigError):
            _check(given, "procedure", load_rig(file))
            return tuple(sorted(missing))
    return ()


def _is_right(reports: Sequence[FileReport]) -> bool:
    wrong = any(report.problem is not None and not report.missing for report in reports)
    return not wrong and (_fits(reports) or not any(report.missing for report in reports))


def _fits(reports: Sequence[FileReport]) -> bool:
    return any(report.kind == "procedure" and report.problem is None for report in reports)


def _show(reports: Sequence[FileReport], rig: RigConfig | None) -> None:
    """Print a line for each file, every problem of a wrong file, and the number of wrong files."""
    name = "" if rig is None else rig.name
    is_error = not _fits(reports)
    for report in reports:
        if report.problem is None:
            print(f"{report.given}: {report.summary}")
        elif report.missing:
            line = f"{report.given}: for another rig: {name} has no {', '.join(report.missing)}"
            hint = "\n  check each of them against its own rig: --rig RIG"
            print(
                f"rigd: {line}{hint}" if is_error else line, file=sys.stderr if is_error else None
            )
        else:
            sys.stdout.flush()
            print(f"rigd: {report.problem}", file=sys.stderr)
    if len(reports) > 1:
        right = sum(report.problem is None for report in reports)
        others = [report for report in reports if report.missing]
        wrong = len(reports) - right - len(others)
        parts = [f"{right} right"]
        if others:
            devices = sorted({device for report in others for device in report.missing})
            parts.append(f"{len(others)} for another rig (no {', '.join(devices)})")
        parts += [f"{wrong} wrong"] * (wrong > 0)
        print(", ".join(parts))


def _check(given: str, kind: str, rig: RigConfig | None) -> str:
    """Check a file and return its summary.

    Raises:
        ConfigError: the file is wrong.
    """
    from rigd.computed.driver import ComputedConfig
    from rigd.config.calibration.calibration import load_calibration
    from rigd.config.checks.following import blind_below, trip_without_value, unsupervised
    from rigd.config.lab.lab import load_lab
    from rigd.config.loader import load_rig
    from rigd.config.settings import read_settings

    if kind == "calibration":
        calibration = load_calibration(Path(given))
        last = calibration.valid_until
        valid = "none expires" if last is None else f"all valid until {last}"
        if last is not None and last < datetime.now(UTC).date():
            valid = f"not all of them valid: the first value expired on {last}"
        return (
            f"calibration {calibration.name}, {len(calibration.values)} values, {valid}: valid file"
        )
    if kind == "lab":
        lab = load_lab(Path(given))
        count = sum(item.required for item in lab.fields.values())
        return f"lab {lab.name}, {len(lab.fields)} fields, {count} required: right"
    if kind == "settings":
        settings = read_settings(Path(given))
        load_rig(settings.default_rig)
        return f"settings of a folder, default rig {settings.default_rig}: right"
    if kind == "specimen":
        from rigd.config.document import read_document
        from rigd.config.lab.lab import read_specimen

        specimen = read_specimen(read_document(Path(given)), Path(given).stem)
        return f"specimen {specimen.name}, {len(specimen.fields)} entries: right{_texts(specimen)}"
    if kind == "rig":
        checked = load_rig(given)
        _read_named_files(checked)
        sibling = f"{_certificates_text(checked)}{_sibling_text(checked)}"
        channels = sum(len(device.channels) for device in checked.devices.values())
        devices = sum(
            not isinstance(item.config, ComputedConfig) for item in checked.devices.values()
        )
        parts = [f"rig {checked.name}", f"{devices} devices", f"{channels} channels"]
        if checked.calibration is not None:
            held = checked.calibration.held
            if held is None:
                missing = (
                    f"right, but the calibration file {checked.calibration.path} does not exist yet"
                )
                return f"{', '.join(parts)}: {missing}{sibling}"
            parts.append(f"calibration {held.name}")
        free = "".join(
            f"\n  no interlock follows {name}: a drive that does not act on it is not noticed"
            for name in unsupervised(checked)
        )
        free += "".join(
            f"\n  {text}" for text in (*blind_below(checked), *trip_without_value(checked))
        )
        return f"{', '.join(parts)}: right{sibling}{free}"
    return _check_procedure(given, rig)


def _read_named_files(rig: RigConfig) -> None:
    """Read what a rig file names and a run reads: its lab, the parameters of its plant.

    Raises:
        ConfigError: one of these files is wrong.
    """
    from rigd.config.lab.lab import load_lab

    if rig.lab is not None:
        load_lab(rig.lab)
    if rig.plant is not None:
        rig.plant.config.files()


def _texts(specimen: Specimen) -> str:
    """Return which entries look like a quantity and are texts; empty if none."""
    from rigd.catalogue.values import begins_with_number, value_of

    texts = [
        f"{name} ({text!r})"
        for name, text in specimen.fields.items()
        if begins_with_number(text) and value_of(text).number is None
    ]
    return f"; kept as text, since it is no number with a unit: {', '.join(texts)}" if texts else ""


def _certificates_text(rig: RigConfig) -> str:
    """Return a line on certificates that are not there yet; "" without.

    Raises:
        ConfigError: one of them is none, has expired, or does not belong to the others.
    """
    tls = rig.remote.tls
    if tls is None:
        return ""
    absent = [path for path in (tls.ca, tls.certificate, tls.key) if not path.exists()]
    if absent:
        return f"\n  {absent[0]} does not exist yet: `rigd remote setup-tls` makes certificates"
    from rigd.model.errors import ConfigError
    from rigd.remote.certificates import check_usable, distrusted

    check_usable(tls)
    if why := distrusted(tls):
        raise ConfigError(why, hint="`rigd remote setup-tls` makes those that are missing")
    return ""


def _sibling_text(rig: RigConfig) -> str:
    """Return a line on the simulated sibling of ``rig``; "" without one.

    Raises:
        ConfigError: the sibling is wrong, or has other names.
    """
    from rigd.config.sibling.sibling import read_sibling

    sibling = read_sibling(rig)
    if sibling is None:
        return ""
    count = len(sibling.differences)
    differs = "differs in nothing" if not count else (
        f"{count} {'difference' if count == 1 else 'differences'}, which a dry run lists"
    )  # fmt: skip
    return f"\n  sibling {sibling.rig.name} ({sibling.rig.source.path}): right, {differs}"


def _check_procedure(given: str, rig: RigConfig | None) -> str:
    from rigd.config.shipped_files import titled
    from rigd.procedure.loader import load_procedure

    procedure = load_procedure(given)
    if rig is None:
        return "a procedure with right keys; give --rig, or try_on, to check it against a rig"
    from rigd.analysis.plan import analysis_of, judged, not_given
    from rigd.config.checks.following import unseen_levels

    _read_named_files(rig)
    compiled = judged(procedure, rig)
    left_out = ""
    if compiled.identify is not None:
        analysis = analysis_of(compiled.identify)
        left_out = "".join(
            f"\n  the rig states {name}, which model {compiled.identify.model} takes: give it as "
            f"`{name}: ${{rig.{name}}}` under `identify: constants:`, or it does not count"
            for name in not_given(compiled.identify, analysis, rig)
        )
    count = len(compiled.trials)
    trials = "1 trial" if count == 1 else f"{count} trials"
    found = "" if procedure.document.path == Path(given) else procedure.location
    unseen = "".join(
        f"\n  {text}" for text in unseen_levels(compiled.on(rig), compiled.constant_levels())
    )
    lacking = _lacking_sibling(compiled, rig)
    title = titled(compiled.name, found)
    return f"procedure {title}, {trials} on {rig.name}: right{left_out}{unseen}{lacking}"


def _lacking_sibling(procedure: CompiledProcedure, rig: RigConfig) -> str:
    """Return a line on what keeps the sibling of ``rig`` from a dry run; "" if it can play it."""
    from rigd.config.sibling.sibling import read_sibling
    from rigd.model.errors import Blocked, ConfigError

    with suppress(ConfigError):  # a sibling that is wrong: the check of the rig file names it
        sibling = read_sibling(rig)
        if sibling is not None:
            from rigd.dry_run.elsewhere import for_sibling  # with numerics

            try:
                for_sibling(procedure, sibling.stand_in(rig), rig)
            except Blocked as lack:
                reason = lack.reasons[0].splitlines()[0]
                return f"\n  no dry run on the sibling {sibling.rig.name}: {reason}"
    return ""


def _instead_of(path: Path, *shipped: str) -> str:
    """Return a hint for a missing file: the shipped file of its name, or what is near to its name.

    ``shipped`` are the hints of the search among shipped procedures and rigs. A name that is only
    somewhat alike is no hint: it would be a file of another kind.
    """
    for hint in shipped:
        if hint.startswith("to use"):
            return hint
    found = [match[1] for match in map(re.compile("did you mean '(.+)'").match, shipped) if match]
    here = [str(item) for item in sorted(path.parent.glob("*.yaml"))]

    def likeness(name: str) -> float:
        return SequenceMatcher(None, path.stem, Path(name).stem).ratio()

    nearest = max((*here, *found), key=likeness, default="")
    if likeness(nearest) >= _NEAR:
        return f"did you mean {nearest!r}?"
    return "give the path of a file, or the name of a shipped procedure or rig"


def _kind(given: str) -> str:
    """Return the kind of the file ``given``, from its keys, or from its name if it is unknown."""
    from rigd.config.shipped_files import find_file
    from rigd.model.errors import ConfigError

    path = Path(given)
    if path.is_dir():
        raise ConfigError(
            f"{given} is a folder", hint=(f"check the files in this folder: {path / '*.yaml'}")
        )
    if not path.is_file():
        refused = []
        for folder, kind in _SHIPPED:
            try:
                find_file(given, folder)
            except ConfigError as error:
                refused.append(error.hint or "")
            else:
                return kind
        as_procedure, as_rig = refused
        if not path.suffix:
            is_rig = as_rig.startswith("did you mean") or not as_procedure.startswith(
                "did you mean"
            )
            return "rig" if is_rig else "procedure"
        raise ConfigError(
            f"file {given!r} does not exist", hint=_instead_of(path, as_procedure, as_rig)
        )
    try:
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    except OSError as error:
        raise ConfigError(
            f"cannot read {given}: {error.strerror}", hint="check its permissions"
        ) from error
    keys = re.findall(r"^[\"']?([A-Za-z_]\w*)[\"']?:", text, re.MULTILINE)
    if keys[:1] == ["default_rig"]:
        return "settings"
    if keys[:1] == ["specimen"]:  # what else it states may be called lab or rig too
        return "specimen"
    # A rig file names its calibration and its lab too.
    for kind in ("rig", "procedure", "calibration", "lab", "specimen"):
        if kind in keys:
            return kind
    # The key that names the kind is missing: use the keys that only one kind of file has.
    for key, kind in (("devices", "rig"), ("interlocks", "rig"), ("values", "calibration")):
        if key in keys:
            return kind
    return "procedure"


def _as_json(report: FileReport) -> dict[str, object]:
    error = report.problem
    if error is None:
        return {"file": report.given, "right": True, "summary": report.summary}
    problems = [
        {
            "message": item.message,
            "hint": item.hint,
            "line": None if item.place is None else item.place.line,
            "column": None if item.place is None else item.place.column,
        }
        for item in (error, *error.others)
    ]
    missing = list(report.missing)
    return {
        "file": report.given, "right": False, "missing_devices": missing, "problems": problems
    }  # fmt: skip
