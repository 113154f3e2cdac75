"""Runs the checks of this machine and of a rig; the checks that open a device come last."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rigd.config.rig import RigConfig
from rigd.daemon.doctor.calibration import examine_calibration
from rigd.daemon.doctor.certificates import examine_certificates
from rigd.daemon.doctor.check import OnCheck
from rigd.daemon.doctor.machine import examine_machine
from rigd.daemon.doctor.rig import examine_rig
from rigd.daemon.doctor.storage import StorageNeeds, examine_storage
from rigd.daemon.doctor.timing import examine_timing
from rigd.daemon.forms import RING_S
from rigd.daemon.signals import handle_signals
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.play.control import Control
from rigd.engine.row_rates import most_rows_hz, ring_rows
from rigd.model.rows import row_struct


@dataclass(frozen=True)
class Examination:
    """The scope of the doctor: this machine and, if given, ``rig``; how long, and for which disk.

    ``seconds`` is the length of each measurement; there are two.
    """

    rig: RigConfig | None
    seconds: float
    runs: Path


def examine(what: Examination, on_check: OnCheck) -> bool:
    """Examine, and report every check when it is made; return False if the user interrupted."""
    rig = what.rig
    for check in examine_machine():
        on_check(check)
    for check in examine_storage(what.runs, None if rig is None else _needs(rig)):
        on_check(check)
    for check in examine_timing(rig, what.seconds):
        on_check(check)
    if rig is None:
        return True
    for check in examine_calibration(rig, datetime.now(UTC).date()):
        on_check(check)
    for check in examine_certificates(rig, datetime.now(UTC)):
        on_check(check)
    control = Control()
    with handle_signals(control):
        examine_rig(rig, what.seconds, control, on_check)
    return control.asked is None


def _needs(rig: RigConfig) -> StorageNeeds:
    streams = [(item, row_struct(item).size) for item in streams_of(rig)]
    return StorageNeeds(
        sum(size * most_rows_hz(rig, stream) for stream, size in streams),
        sum(size * ring_rows(rig, stream, RING_S) for stream, size in streams),
    )
