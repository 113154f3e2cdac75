"""Reads the calibration and the rig constants that the evaluation of approach-angle runs needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from rigd.analysis import DataError, parse_unit
from rigd.analysis.calibration import (
    ATTACHMENT,
    CalibratedValue,
    Calibration,
    load_calibration,
    parse_calibration,
)
from rigd.analysis.recordings.source import RecordedSweep, TrialInfo
from rigd.analysis.report.rounding import number, percent, places_for
from rigd_analyses.approach_angle.needs import NEEDS
from rigd_analyses.approach_angle.raw.run_data import (
    UNKNOWN_RISE,
    UNKNOWN_SHARE,
    AngleCalibration,
    AngleRig,
    Known,
)


@dataclass(frozen=True)
class Calibrated:
    """The calibration used to evaluate a recording, and its differences from the recorded one."""

    used: Calibration
    replayed: bool  #: another file than the one that the recording carries
    changes: tuple[str, ...] = ()  #: of the values, a line each, if it is replayed

    @property
    def described(self) -> str:
        """Which calibration it is, in words; the hash separates two of one name and day."""
        made = "" if self.used.made is None else f" of {self.used.made.isoformat()}"
        origin = "given with --calibration" if self.replayed else "as recorded"
        return f"{self.used.name}{made} (sha256 {self.used.sha256[:8]}), {origin}"


def calibration_of(sweep: RecordedSweep, other: Path | None) -> Calibrated:
    """Return the calibration that ``sweep`` carries, or the one in the file ``other``.

    Raises:
        ConfigError: the calibration is wrong.
        DataError: the recording carries none, and no other one is given.
    """
    attached = sweep.recording.attachments.get(ATTACHMENT)
    recorded = None
    if attached is not None:
        text = attached.data.decode(errors="replace")
        recorded = parse_calibration(text, f"{sweep.path}:{ATTACHMENT}")
    if other is None:
        if recorded is None:
            raise DataError(
                f"{sweep.path} carries no calibration: volts cannot become torque and travel",
                hint="`calibration:` in the rig file names one; for this recording, give "
                "--calibration FILE",
            )
        return Calibrated(recorded, replayed=False)
    replaced = load_calibration(other)
    if recorded is None:
        return Calibrated(replaced, replayed=True, changes=("the recording carries none",))
    return Calibrated(replaced, True, _changes(recorded.values, replaced.values))


def _changes(
    old: Mapping[str, CalibratedValue], new: Mapping[str, CalibratedValue]
) -> tuple[str, ...]:
    """Return what differs between two calibrations, a line for each value."""
    lines = []
    for name in dict.fromkeys((*old, *new)):
        a, b = old.get(name), new.get(name)
        if a is None or b is None:
            lines.append(f"{name}: {'added' if a is None else 'left out'}")
        elif (a.value, a.u) != (b.value, b.u):
            change = (
                f" ({percent(b.value / a.value - 1.0)})" if a.value and b.value != a.value else ""
            )
            lines.append(f"{name}: {_spread(a)} -> {_spread(b)}{change}")
    return tuple(lines) or ("no value differs",)


def _spread(calibrated_value: CalibratedValue) -> str:
    """Return value ± u in the value's unit, to the digits that u leaves meaning."""
    factor = parse_unit(calibrated_value.unit).factor
    value, u = calibrated_value.value / factor, calibrated_value.u / factor
    places = places_for(u)
    return f"{number(value, places)} ± {number(u, places)} {calibrated_value.unit}".removesuffix(
        " 1"
    )


def angle_calibration(sweep: RecordedSweep, calibration: Calibration) -> AngleCalibration:
    """Return what turns the volts of ``sweep`` into quantities.

    Raises:
        DataError: a value is missing.
    """
    known = _needed(sweep, calibration)
    loaded = "normal_force" in sweep.plan.signals
    return AngleCalibration(
        torque=known["torque_scale"],
        wheel=known["wheel_scale"],
        platform=known["platform_scale"],
        load=known["load_scale"],
        normal_force=known["normal_force_scale"] if loaded else None,
        normal_force_zero=known["normal_force_zero"] if loaded else Known(0.0),
        gauge_share=_optional(calibration, "gauge_share", UNKNOWN_SHARE),
    )


def angle_rig(sweep: RecordedSweep, trial: TrialInfo, calibration: Calibration) -> AngleRig:
    """Return what is known of the rig as it was in ``trial``.

    Raises:
        DataError: a constant or a value is missing, or cannot be.
    """
    known = _needed(sweep, calibration)
    return AngleRig(
        wheel_radius_m=_positive(sweep, trial, "wheel_radius"),
        wheel_inertia=_positive(sweep, trial, "wheel_inertia"),
        platform_mass_kg=_positive(sweep, trial, "platform_mass"),
        gravity=_positive(sweep, trial, "gravity"),
        effective_radius=known["effective_radius"],
        bearing_constant=known["bearing_constant"],
        bearing_viscous=known["bearing_viscous"],
        bearing_load=known["bearing_load"],
        rolling_resistance=known["rolling_resistance"],
        roller_drag=known["roller_drag"],
        rail_constant=known["rail_constant"],
        rail_load=known["rail_load"],
        rail_viscous=known["rail_viscous"],
        load_rise=_optional(calibration, "load_rise", UNKNOWN_RISE),
    )


def _optional(calibration: Calibration, name: str, default: Known) -> Known:
    value = calibration.values.get(name)
    return default if value is None else Known(value.value, value.u)


def _needed(sweep: RecordedSweep, calibration: Calibration) -> dict[str, Known]:
    """Return the values that evaluating ``sweep`` rests on; they have the units of the model."""
    needed = NEEDS.calibration(sweep.plan.signals)
    missing = [name for name in needed if name not in calibration.values]
    if missing:
        raise DataError(
            f"calibration {calibration.name} has no {', '.join(missing)}",
            hint="`rigd calibrate` measures it, or add it to the calibration file",
        )
    values = calibration.values
    return {name: Known(values[name].value, values[name].u) for name in needed}


def _positive(sweep: RecordedSweep, trial: TrialInfo, name: str) -> float:
    value = sweep.constant(trial, name)
    if not value > 0.0:
        raise DataError(f"{sweep.path}: the constant {name} is {value:g}, must be above 0")
    return value
