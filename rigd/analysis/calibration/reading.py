"""Reads the recording of a calibration: means over named steps, and the announced values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.result import FloatArray
from rigd.config.calibration.calibration import (
    ATTACHMENT,
    CalibratedValue,
    Calibration,
    load_calibration,
    parse_calibration,
)
from rigd.model.channels import STALE, STATUS_FIELD
from rigd.model.errors import DataError
from rigd.model.rows import TIME_FIELD
from rigd.record import Event, TrialInfo

#: Means are taken over a whole number of these: 5 periods of 50 Hz, 6 of 60 Hz.
HUM_NS: Final = 100_000_000


@dataclass(frozen=True)
class Steps:
    """One recording of a calibration, read by the names of its steps.

    ``given`` is what was known before, instead of the calibration that the recording carries.
    """

    sweep: RecordedSweep
    given: Calibration | None = None

    @cached_property
    def _events(self) -> list[Event]:
        return list(self.sweep.recording.events())

    def span(self, trial: TrialInfo, step: str) -> tuple[int, int]:
        """Return when ``step`` of ``trial`` began and ended, in ns.

        Raises:
            DataError: the trial has no such step.
        """
        last_ns = self.sweep.recording.end_ns if trial.end_ns is None else trial.end_ns
        for played in self.sweep.recording.steps:
            inside = trial.start_ns <= played.start_ns <= last_ns
            if (played.name, played.trial, inside) == (step, trial.number, True):
                return played.start_ns, last_ns if played.end_ns is None else played.end_ns
        raise DataError(
            f"{self.sweep.path}: trial {trial.number} has no step {step!r}",
            hint="the shipped procedures calibrate_*.yaml show what a calibration needs",
        )

    def signal(self, name: str, span: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
        """Return times (n,) in s since ``span`` began, and the fresh samples (n,) of a signal, SI.

        Raises:
            DataError: it was not recorded, has no sample there, or one that is no number.
        """
        stream, field = self.sweep.field(name)
        rows = self.sweep.recording.read(stream.name, *span)
        if stream.has_status:
            rows = rows[rows[STATUS_FIELD] & STALE == 0]
        if not len(rows):
            raise DataError(f"{self.sweep.path}: {stream.name} gave no sample in a step")
        times = (rows[TIME_FIELD] - span[0]) * 1e-9
        values = np.asarray(rows[field], dtype=np.float64)
        if wrong := int(np.count_nonzero(~np.isfinite(values))):
            raise DataError(
                f"{self.sweep.path}: {wrong} of {len(values)} samples of {stream.name}.{field} in "
                "a step are no numbers",
                hint="look at the sensor and its cable, and run the calibration again",
            )
        return np.asarray(times), values

    def mean(self, name: str, span: tuple[int, int]) -> float:
        """Return the mean of a signal over whole periods of the mains at the end of ``span``.

        Raises:
            DataError: the span holds no whole period, or no sample.
        """
        whole = (span[1] - span[0]) // HUM_NS * HUM_NS
        if not whole:
            raise DataError(
                f"{self.sweep.path}: a step of {1e-6 * (span[1] - span[0]):.0f} ms is too short "
                f"for a mean; it needs {1e-6 * HUM_NS:.0f} ms"
            )
        return float(np.mean(self.signal(name, (span[1] - whole, span[1]))[1]))

    def announced(self, trial: TrialInfo, quantity: str, parameter: str) -> float:
        """Return what was announced of ``quantity`` in ``trial``, else its ``parameter``, SI.

        Raises:
            DataError: neither is there.
        """
        for event in reversed(self._of(trial, "answer")):
            given = event.data.get("answer")
            if event.data.get("changes") == quantity and isinstance(given, int | float):
                return float(given)
        value = trial.parameters.get(parameter)
        if not isinstance(value, int | float):
            raise DataError(f"{self.sweep.path}: trial {trial.number} has no {parameter!r}")
        return float(value)

    def constant(self, name: str) -> float:
        """Return a known quantity of the plan, the same in every trial, in SI.

        Raises:
            DataError: the plan does not have it, or it differs from trial to trial.
        """
        values = {self.sweep.constant(trial, name) for trial in self.sweep.trials}
        if len(values) > 1:
            raise DataError(
                f"{self.sweep.path}: the constant {name!r} differs from trial to trial",
                hint="a calibration takes one value for all of them",
            )
        return values.pop()

    def known(self, name: str) -> CalibratedValue:
        """Return a value that was calibrated before.

        Raises:
            ConfigError: the calibration that the recording carries is wrong.
            DataError: there is no such value.
        """
        calibration = self._calibration
        if calibration is None or name not in calibration.values:
            where = "the recording" if calibration is None else f"calibration {calibration.name}"
            raise DataError(
                f"{self.sweep.path}: {name} is needed, and {where} has none",
                hint="calibrate it first, or give --calibration FILE",
            )
        return calibration.values[name]

    @cached_property
    def _calibration(self) -> Calibration | None:
        if self.given is not None:
            return self.given
        attached = self.sweep.recording.attachments.get(ATTACHMENT)
        if attached is None:
            return None
        text = attached.data.decode(errors="replace")
        return parse_calibration(text, f"{self.sweep.path}:{ATTACHMENT}")

    def instruments(self) -> dict[str, str]:
        """Return the reported identity of each device that gave a signal, if it reported one."""
        identities = {
            name: str(identity)
            for event in self._events
            if event.kind == "devices"
            for name, identity in event.data.items()
        }
        used = dict.fromkeys(self.sweep.field(name)[0].name for name in self.sweep.plan.signals)
        return {name: identities[name] for name in used if identities.get(name)}

    def _of(self, trial: TrialInfo, kind: str) -> list[Event]:
        """Return the events of a kind in this attempt; the next trial may begin as it ends."""
        end = self.sweep.recording.end_ns if trial.end_ns is None else trial.end_ns
        return [
            event
            for event in self._events
            if (event.kind, event.trial) == (kind, trial.number)
            and trial.start_ns <= event.t_ns <= end
        ]


def steps_of(sweeps: Sequence[RecordedSweep], known: Path | None) -> Steps:
    """Return the one recording of a calibration; ``known`` is a file of what was known before.

    Raises:
        ConfigError: the file is wrong.
        DataError: there are several recordings, or no trial came to its end.
    """
    if len(sweeps) > 1:
        raise DataError(f"{len(sweeps)} recordings at once", hint="evaluate them one at a time")
    (sweep,) = sweeps
    if not sweep.trials:
        raise DataError(f"{sweep.path}: no trial came to its end", hint="run the calibration again")
    return Steps(sweep, None if known is None else load_calibration(known))
