"""Writes the values that a calibration measured into the calibration file of the rig."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from shlex import quote
from typing import Final

from rigd.analysis.analysis import Options
from rigd.analysis.calibration.evaluation import CalibrationEvaluation
from rigd.analysis.evaluation import evaluate
from rigd.analysis.report.rounding import number, places_for
from rigd.config.calibration.calibration import CalibratedValue, Calibration, load_calibration
from rigd.config.calibration.calibration_file import renewed, write_calibration
from rigd.config.rig import RigConfig
from rigd.daemon.calibration_check import instrument_of
from rigd.model.errors import ConfigError, DataError
from rigd.record import Recording, RunInfo
from rigd.record.read.info import COMPLETE
from rigd.sdk.shipped_files import shipped_folder

#: A change of more standard uncertainties than this is not chance.
_FAR: Final = 3.0


@dataclass(frozen=True)
class Signature:
    """The person responsible for a calibration, its date, and for how many days it may be used."""

    operator: str
    made: date
    days: int

    @classmethod
    def of(cls, evaluation: CalibrationEvaluation, operator: str, days: int) -> Signature:
        """Return that of the day of the recording; of today if that was in virtual time."""
        return cls(operator, evaluation.made or datetime.now(UTC).date(), days)

    @property
    def valid_until(self) -> date:
        """The last day."""
        return self.made + timedelta(days=self.days)


@dataclass(frozen=True)
class CalibrationPlace:
    """The file to which a calibration is written, and the calibration that it renews.

    ``old`` is the calibration that is renewed; ``before`` the text of the file that is overwritten,
    None without a file; ``shipped`` the shipped file of which a copy is written.
    """

    path: Path
    old: Calibration | None
    before: str | None
    shipped: Path | None = None


@dataclass(frozen=True)
class Renewal:
    """The new content of a calibration file, and the file that it replaces."""

    new: Calibration
    place: CalibrationPlace
    measured: tuple[str, ...]
    signature: Signature

    def was(self, name: str) -> CalibratedValue | None:
        """Return the value that is replaced, None if there was none."""
        return None if self.place.old is None else self.place.old.values.get(name)

    def deviation(self, name: str) -> float:
        """Return (new - old)/u of a value, u of both together; NaN without an old value."""
        now, was = self.new.values[name], self.was(name)
        if was is None:
            return math.nan
        u = math.hypot(now.u, was.u)
        return (now.value - was.value) / u if u else math.nan

    def is_older(self, name: str) -> bool:
        """Return whether a value was measured on an earlier day than the value it replaces."""
        was = self.was(name)
        return was is not None and self.new.values[name].made < was.made

    def remarks(self) -> list[str]:
        """Return what a person must know before the file is written."""
        remarks = []
        if far := [name for name in self.measured if abs(self.deviation(name)) > _FAR]:
            remarks.append(
                f"{', '.join(far)}: more than {_FAR:g} u from the old value. The rig has changed, "
                "or one of the two values is wrong."
            )
        if late := [name for name in self.measured if self.is_older(name)]:
            remarks.append(
                f"{', '.join(late)}: the new value was measured before the value that it replaces."
            )
        return remarks

    def write(self) -> None:
        """Write the file, whole or not at all.

        Raises:
            ConfigError: it has been changed since, or cannot be written.
        """
        write_calibration(self.new, self.place.before)


def place_of(rig: RigConfig, write: Path | None = None) -> CalibrationPlace:
    """Return the file in which the calibration of ``rig`` is renewed; ``write`` names another file.

    A shipped file is never changed: a copy is.

    Raises:
        ConfigError: there is no file to write to, it is wrong, or that of another rig.
    """
    path, shipped = (write, None) if write is not None else _target(rig)
    if not path.is_file():
        held = None if rig.calibration is None else rig.calibration.held
        # A calibration of another rig does not hold for this rig.
        return CalibrationPlace(
            path, held if held and rig.name in held.rigs else None, None, shipped
        )
    old = load_calibration(path)
    if rig.name not in old.rigs:
        raise ConfigError(
            f"{path} is the calibration of {', '.join(old.rigs)}, not of {rig.name}",
            hint="give --write another FILE; if it is the same bench, add it to `rigs:` there",
        )
    return CalibrationPlace(path, old, old.text, shipped)


def check_calibrates(info: RunInfo, rig: RigConfig) -> None:
    """Check that a recording is a complete run on ``rig``.

    Raises:
        ConfigError: it is of another rig.
        DataError: it did not complete.
    """
    if rig.name != info.rig:
        raise ConfigError(
            f"{info.path} was recorded on rig {info.rig}, not on {rig.name}",
            hint="a calibration belongs to the rig that it was measured on",
        )
    if info.state != COMPLETE:
        raise DataError(
            f"{info.path} is of a run that did not complete ({info.state}): nothing is calibrated",
            hint=f"`rigd run --resume {quote(str(info.path))}` plays the missing trials, "
            f"`rigd identify {quote(str(info.path))}` shows the results so far",
        )


def evaluated(
    recording: Path,
    rig: RigConfig,
    place: CalibrationPlace,
    passed_over: Callable[[str], None] = lambda _: None,
) -> CalibrationEvaluation:
    """Return the values that ``recording`` calibrates; ``passed_over`` gets each loss in it.

    Values that were measured before are those of the calibration that is renewed.

    Raises:
        ConfigError, DataError: it calibrates nothing on ``rig``.
    """
    check_calibrates(Recording.open(recording).info, rig)
    known = None if place.old is None else place.old.path
    evaluation = evaluate([recording], Options(calibration=known), passed_over=passed_over)
    if not isinstance(evaluation, CalibrationEvaluation):
        raise DataError(
            f"{recording} is a measurement of {evaluation.title}, which does not calibrate "
            "anything",
            hint=f"rigd identify {quote(str(recording))}",
        )
    return evaluation


def spread(value: CalibratedValue) -> str:
    """Return value and standard uncertainty as text, with the places that this deserves."""
    places = places_for(value.u)
    return f"{number(value.value, places)} ± {number(value.u, places)}"


def renewal(
    rig: RigConfig, place: CalibrationPlace, evaluation: CalibrationEvaluation, signature: Signature
) -> Renewal:
    """Return what the calibration of ``rig`` becomes; nothing is written yet.

    Values that were not measured are kept with their own dates.

    Raises:
        DataError: the evaluation refuses its data.
        ConfigError: a value cannot stand in a calibration.
    """
    if evaluation.result.refusals:
        raise DataError(
            f"{evaluation.recording} is no calibration: {'; '.join(evaluation.result.refusals)}",
            hint="nothing is written",
        )
    values = _measured(evaluation, signature)
    new = renewed(
        place.old,
        values,
        name=rig.name,
        rigs=[rig.name],
        path=place.path,
        on=signature.made,
    )
    return Renewal(new, place, tuple(values), signature)


def _target(rig: RigConfig) -> tuple[Path, Path | None]:
    """Return the file to write, and the shipped file of which it is a copy."""
    if rig.calibration is None:
        raise ConfigError(
            f"rig {rig.name} names no calibration file",
            hint=f"add `calibration: calibrations/{rig.name}.yaml` to {rig.source.path}, or give "
            "--write FILE",
        )
    path, folder = rig.calibration.path, shipped_folder("configs").resolve()
    if not path.resolve().is_relative_to(folder):
        return path, None
    own = rig.source.path.resolve()
    beside = Path() if own.is_relative_to(folder) else rig.source.path.parent
    return beside / path.resolve().relative_to(folder), path


def _measured(
    evaluation: CalibrationEvaluation, signature: Signature
) -> Mapping[str, CalibratedValue]:
    return {
        name: CalibratedValue(
            value=item.value,
            u=item.u,
            unit=item.unit,
            source="measured",
            origin=evaluation.recording.name,
            made=signature.made,
            operator=signature.operator,
            valid_until=signature.valid_until,
            instruments={
                name: instrument_of(instrument)
                for name, instrument in evaluation.instruments.items()
            },
        )
        for name, item in evaluation.result.measured.items()
    }
