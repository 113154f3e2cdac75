"""What becomes of a run whose processes were all killed: its samples, out of the rings."""

from __future__ import annotations

from pathlib import Path

from rigd.engine.recorder.transfer import Transfer
from rigd.engine.shared import RunFolder


def drain_leftovers(folder: RunFolder) -> Path | None:
    """Put what an earlier run left in ``folder`` into its recording, and clear the folder.

    The folder must be held (:meth:`RunFolder.take`): then nobody pushes any more. Returns the
    recording, or None where nothing was left. The run is marked interrupted, unless its end is
    among what was left.

    Raises:
        RecordingError: the recording cannot be written; everything stays as it is.
    """
    if not folder.has_job:
        folder.clear()
        return None
    transfer = Transfer(folder)
    if transfer.empty and not transfer.begun:
        folder.clear()
        return None
    recording = folder.job.recording
    try:
        transfer.open()
        transfer.finish("all processes of the run were killed")
    finally:
        transfer.close()
    folder.clear()
    return recording
