"""The processes of a run, begun: its folder in memory first, then the cycle and what is beside it.

Nothing is opened here. Whoever keeps what the rings hold (a recorder) begins between the two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from rigd.config.rig import RigConfig
from rigd.engine.control import Control
from rigd.engine.process_host import ProcessHost, Watched
from rigd.engine.rates import ring_rows
from rigd.engine.shared import Job, RunFolder, Word
from rigd.engine.slow.beside import Beside
from rigd.procedure.program import Recorded


def prepare(
    rig: RigConfig, folder: RunFolder, job: Job, *, record: Mapping[str, Recorded], ring_s: float
) -> None:
    """Make the board and the rings of ``job`` in ``folder``; each ring holds ``ring_s`` of rows.

    Raises:
        RecordingError: the folder still holds what an earlier run left, or has no room.
    """
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
        beside=Beside(rig, folder, job, origin_ns=origin_ns, record=record),
        finish=finish,
    )
