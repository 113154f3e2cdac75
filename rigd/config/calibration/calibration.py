"""Reads calibration files: measured values of a rig with uncertainty and expiry.

The rig file names the calibration file (``calibration: calibrations/bench.yaml``). A run attaches
the calibration file to its recording as :data:`ATTACHMENT`. ``rigd calibrate`` writes it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Final

from rigd.config.binding import bind
from rigd.config.calibration.calibratable import calibratable, unknown
from rigd.config.calibration.calibration_source import (
    CalibrationSource,
    Origin,
    ReplacedSource,
    ValueSource,
)
from rigd.config.document import Document, KeyPath, parse_document, read_document
from rigd.config.problems import Problems
from rigd.config.quantities import read_difference, read_quantity
from rigd.model.errors import ConfigError, Place
from rigd.model.units import format_difference, format_quantity
from rigd.sdk.analysis import Calibratable

#: No value of a rig is larger than this in SI, and no scale smaller than its inverse: such a number
#: is a typing error.
LARGEST: Final = 1e9

#: The name under which a recording carries the calibration of its run.
ATTACHMENT: Final = "calibration.yaml"


@dataclass(frozen=True)
class CalibratedValue:
    """A value in SI with its standard uncertainty (k = 1), its operator and its last valid day."""

    value: float
    u: float
    unit: str
    source: Origin
    origin: str  #: the recording, or the reason for an assumption; ``from`` in the file
    made: date
    operator: str
    valid_until: date | None = None  #: the last day; None: an assumed value does not expire
    instruments: Mapping[str, str] = field(default_factory=dict)  #: device -> its identity

    def __str__(self) -> str:
        return (
            f"{format_quantity(self.value, self.unit)} ± {format_difference(self.u, self.unit)} "
            f"({self.source})"
        )

    def expired(self, on: date) -> bool:
        """Return whether the value has expired on that day."""
        return self.valid_until is not None and on > self.valid_until


@dataclass(frozen=True)
class ReplacedValue:
    """A value, and the day on which another value replaced it."""

    name: str
    value: CalibratedValue
    replaced: date


@dataclass(frozen=True)
class Calibration:
    """The calibrated values of the named rigs; ``text`` is the text of their file."""

    name: str
    rigs: tuple[str, ...]
    values: Mapping[str, CalibratedValue]
    history: tuple[ReplacedValue, ...]
    path: Path
    text: str

    @property
    def made(self) -> date | None:
        """The day of the newest value; None without values."""
        return max((value.made for value in self.values.values()), default=None)

    @property
    def valid_until(self) -> date | None:
        """The last day on which every value may be used; None if none expires."""
        days = [
            value.valid_until for value in self.values.values() if value.valid_until is not None
        ]
        return min(days, default=None)

    @property
    def sha256(self) -> str:
        """The hash of its text, by which a recording identifies it."""
        return hashlib.sha256(self.text.encode()).hexdigest()


@dataclass(frozen=True)
class CalibrationSetup:
    """The calibration that a rig file names; ``held`` is None if the file does not exist."""

    path: Path
    held: Calibration | None

    def read_again(self) -> CalibrationSetup:
        """Return what the file is now: it may have been renewed since the rig file was read.

        Raises:
            ConfigError: it cannot be read, or is wrong.
        """
        return CalibrationSetup(
            self.path, load_calibration(self.path) if self.path.is_file() else None
        )


def load_calibration(path: Path) -> Calibration:
    """Return the calibration in the file at ``path``.

    Raises:
        ConfigError: it cannot be read, or is wrong; the error names every problem with its place.
    """
    return _build(read_document(path))


def parse_calibration(text: str, name: str) -> Calibration:
    """Return the calibration in ``text``, such as the text attached to a recording.

    ``name`` is the name in error messages.

    Raises:
        ConfigError: the text is wrong; the error names every problem with its place.
    """
    return _build(parse_document(text, Path(name)))


def read_setup(name: str | None, folder: Path, problems: Problems) -> CalibrationSetup | None:
    """Return the calibration that a rig file in ``folder`` names, or None with problems noted.

    A missing file is not a problem here: it only blocks some runs. A shipped file of that name
    never stands in for it: it is the calibration of another bench.
    """
    if name is None:
        return None
    path = folder / name
    if not path.is_file():
        return CalibrationSetup(path, None)
    try:
        return CalibrationSetup(path, load_calibration(path))
    except ConfigError as error:
        for item in (error, *error.others):
            problems.add(item.place, item.message, item.hint)
        return None


def _build(document: Document) -> Calibration:
    problems = Problems()
    source = bind(document, CalibrationSource, problems)
    if source is None:
        problems.raise_any()
        raise ConfigError("the calibration file cannot be used", place=document.place(()))
    values = {}
    for name, item in source.values.items():
        path: KeyPath = ("values", name)
        known = _known(document.key_place(path), name, problems)
        if known is not None:
            values[name] = _value(document, path, item, known, problems)
    history = []
    for index, old in enumerate(source.history):
        known = _known(document.place(("history", index, "name")), old.name, problems)
        if known is not None:
            value = _value(document, ("history", index), old, known, problems)
            history.append(ReplacedValue(old.name, value, old.replaced))
    problems.raise_any()
    return Calibration(
        source.calibration,
        tuple(source.rigs),
        values,
        tuple(history),
        document.path,
        document.text,
    )


def _known(place: Place, name: str, problems: Problems) -> Calibratable | None:
    known = calibratable().get(name)
    if known is None:
        message = f"unknown calibrated value {name!r}"
        problems.add(place, message, unknown(name))
    return known


def _value(
    document: Document,
    path: KeyPath,
    source: ValueSource | ReplacedSource,
    known: Calibratable,
    problems: Problems,
) -> CalibratedValue:
    value = read_quantity(document, (*path, "value"), source.value, known.unit, problems)
    u = read_difference(document, (*path, "u"), source.u, known.unit, problems)
    place = document.place((*path, "value"))
    if known.sign == "positive" and value <= 0:
        problems.add(place, f"{source.value} must be above 0", known.doc)
    elif abs(value) > LARGEST or (known.sign == "positive" and value < 1 / LARGEST):
        problems.add(place, f"{source.value} is impossible for a rig", known.doc)
    elif u > (value if known.sign == "positive" else LARGEST):
        message = f"with an uncertainty of {source.u} the value {source.value} has no meaning"
        problems.add(document.place((*path, "u")), message, "give the standard uncertainty (k = 1)")
    if known.sign == "not negative" and value < 0:
        problems.add(place, f"{source.value} must not be below 0", known.doc)
    if u < 0:
        problems.add(document.place((*path, "u")), f"the uncertainty {source.u} is below 0",
                     "give the standard uncertainty (k = 1)")  # fmt: skip
    if source.source == "measured" and source.valid_until is None:
        problems.add(document.place(path), "a measured value needs the last day on which it "
                                           "is valid",
                     "add 'valid_until: 2027-11-21'")  # fmt: skip
    if source.valid_until is not None and source.valid_until < source.made:
        message = (
            f"valid_until {source.valid_until} is before {source.made}, the day of the measurement"
        )
        problems.add(document.place((*path, "valid_until")), message)
    return CalibratedValue(
        value,
        u,
        known.unit,
        source.source,
        source.origin,
        source.made,
        source.operator,
        source.valid_until,
        source.instruments,
    )
