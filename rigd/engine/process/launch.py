"""Starts the processes of a run: prepares the run's folder in memory, then starts the cycle.

:func:`prepare` makes the folder. After that the caller may start the recorder, which writes the
rows of the rings to disk. Then :func:`launch` starts the cycle process and the off-cycle devices,
which the cycle does not exchange with itself. This module opens no device.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from rigd.config.rig import RigConfig
from rigd.engine.cycle.wiring import evaluator_of
from rigd.engine.play.control import Control
from rigd.engine.process.process_host import ProcessHost, Watched
from rigd.engine.row_rates import ring_rows
from rigd.engine.shared import Job, RunFolder, Word
from rigd.engine.slow.off_cycle_devices import OffCycleDevices
from rigd.procedure.program import Recorded


def prepare(
    rig: RigConfig, folder: RunFolder, job: Job, *, record: Mapping[str, Recorded], ring_s: float
) -> None:
    """Make the board and the rings of ``job`` in ``folder``; each ring holds ``ring_s`` of rows.

    Raises:
        RecordingError: the folder still contains data of an earlier run, or has no room.
    """
    evaluator_of(rig)  # compiled here, if it is not yet: the cycle process must be in time
    folder.prepare(
        job,
        {
            stream.name: ring_rows(rig, stream, ring_s, record[stream.name].every)
            for stream in job.streams
        },
    )


def launch(
    rig: RigConfig,
    folder: RunFolder,
    job: Job,
    control: Control,
    *,
    record: Mapping[str, Recorded],
    seed: int = 1,
    watched: Sequence[Watched] = (),
    finish: Callable[[], None] | None = None,
) -> ProcessHost:
    """Start the cycle process of ``rig`` in ``folder``, prepared for ``job``; return its host.

    See :class:`ProcessHost` for the other arguments.
    """
    origin_ns = folder.board()[Word.ORIGIN_NS]
    return ProcessHost(
        rig,
        record=record,
        seed=seed,
        folder=folder,
        control=control,
        watched=watched,
        off_cycle=OffCycleDevices(
            rig,
            folder,
            job,
            origin_ns=origin_ns,
            record=record,
            stopped=lambda: control.asked is not None,
        ),
        finish=finish,
    )
