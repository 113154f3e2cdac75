"""Checks that the calibration of a rig exists, is made for this rig, and has not expired."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date

from rigd.analysis.plan import analysis_of
from rigd.config.calibration.calibratable import calibratable
from rigd.config.calibration.calibration import Calibration
from rigd.config.rig import RigConfig
from rigd.config.shipped_files import find_file
from rigd.model.errors import ConfigError
from rigd.procedure.program import CompiledProcedure


def needed(procedure: CompiledProcedure, rig: RigConfig) -> tuple[str, ...]:
    """Return the calibrated values that the analysis of ``procedure`` on ``rig`` uses.

    Values that it uses only if they are known are included if the calibration has them. A procedure
    without an analysis, or whose analysis uses no calibrated value, needs none.
    """
    plan = procedure.identify
    if plan is None:
        return ()
    needs, setup = analysis_of(plan).needs, rig.calibration
    held = {} if setup is None or setup.held is None else setup.held.values
    known = (name for name in needs.calibrated_if_known if name in held)
    return (*needs.calibration(plan.signals), *known)


def unusable(rig: RigConfig, names: Sequence[str], on: date) -> list[str]:
    """Return why ``names`` cannot be taken from the calibration of ``rig`` on that day."""
    if not names:
        return []
    setup = rig.calibration
    if setup is None:
        return [
            f"rig {rig.name} has no calibration: its volts cannot be converted to quantities\n"
            f"  name one in the rig file, `calibration: calibrations/{rig.name}.yaml`"
        ]
    if setup.held is None:
        return [f"there is no calibration file {setup.path}\n  {_remedy(rig, names)}"]
    return [*_foreign(rig, setup.held), *_values(rig, setup.held, names, on)]


def exchanged(rig: RigConfig, names: Iterable[str], identities: Mapping[str, str]) -> Iterator[str]:
    """Yield the devices with which ``names`` were not measured, one sentence each.

    ``identities`` are what the devices reported when they were opened.
    """
    setup = rig.calibration
    if setup is None or setup.held is None:
        return
    found: dict[tuple[str, str], list[str]] = {}
    for name in names:
        value = setup.held.values.get(name)
        for device, instrument in ({} if value is None else value.instruments).items():
            if not _is(identities.get(device, ""), instrument):
                found.setdefault((device, instrument), []).append(name)
    for (device, instrument), theirs in found.items():
        reported = identities.get(device, "")
        now = f"reports {reported!r}" if reported else "does not report its type"
        if device not in rig.devices:
            now = f"is no device of rig {rig.name}"
        yield (
            f"{device} {now}, but {_list(theirs)} in {setup.path} "
            f"{'was' if len(theirs) == 1 else 'were'} measured with {instrument!r}\n"
            f"  {_remedy(rig, theirs)}"
        )


def instrument_of(identity: str) -> str:
    """Return the part of ``identity`` that identifies the device: its serial number, or all of it.

    Versions of software, which it also contains, may change.
    """
    pieces = identity.split(", ")
    return next((piece for piece in pieces if piece.startswith("serial number ")), identity)


def calibration_metadata(rig: RigConfig) -> dict[str, dict[str, str]]:
    """Return the metadata record ``calibration`` of a run on ``rig``; none if it has no file."""
    if rig.calibration is None or rig.calibration.held is None:
        return {}
    held = rig.calibration.held
    last = held.valid_until
    return {
        "calibration": {
            "name": held.name,
            "made": "" if held.made is None else held.made.isoformat(),
            "valid_until": "" if last is None else last.isoformat(),
            "sha256": held.sha256,
        }
    }


def command_for(rig: RigConfig, procedure: str) -> str:
    """Return the command that measures the values that ``procedure`` calibrates, on ``rig``."""
    return f"rigd calibrate procedures/{procedure}.yaml --rig {_rig_given(rig)} --operator NAME"


def _foreign(rig: RigConfig, held: Calibration) -> Iterator[str]:
    if rig.name not in held.rigs:
        yield (
            f"{held.path} is the calibration of {', '.join(held.rigs)}, not of {rig.name}\n"
            "  calibrate this rig; if it is the same bench, add its name under `rigs:` there"
        )


def _values(rig: RigConfig, held: Calibration, names: Sequence[str], on: date) -> Iterator[str]:
    missing = [name for name in names if name not in held.values]
    if missing:
        yield f"{held.path} has no {_list(missing)}\n  {_remedy(rig, missing)}"
    expired: dict[date, list[str]] = {}
    for name in names:
        value = held.values.get(name)
        if value is not None and value.valid_until is not None and value.expired(on):
            expired.setdefault(value.valid_until, []).append(name)
    for day, theirs in sorted(expired.items()):
        yield f"{_list(theirs)} in {held.path} expired on {day}\n  {_remedy(rig, theirs)}"


def _remedy(rig: RigConfig, names: Iterable[str]) -> str:
    """Return how to renew ``names``: the procedures that measure them, or a person."""
    measured_by = {name: calibratable()[name].procedure for name in names}
    procedures = dict.fromkeys(item for item in measured_by.values() if item)
    by_hand = [name for name, procedure in measured_by.items() if not procedure]
    parts = [command_for(rig, item) for item in procedures]
    if by_hand:
        parts.append(f"write {_list(by_hand)} into the file, with the source of the value")
    return "; ".join(parts)


def _list(names: Sequence[str]) -> str:
    return ", ".join(names)


def _is(identity: str, instrument: str) -> bool:
    return instrument == identity or instrument in identity.split(", ")


def _rig_given(rig: RigConfig) -> str:
    """Return the name of ``rig`` if it is found by its name, else the path of its file."""
    try:
        found = find_file(rig.name, "configs")
    except ConfigError:
        return str(rig.source.path)
    same = found.resolve() == rig.source.path.resolve()
    return rig.name if same else str(rig.source.path)
