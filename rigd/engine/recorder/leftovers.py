"""Recovers the samples in the rings of a run whose processes were all killed."""

from __future__ import annotations

from pathlib import Path

from rigd.engine.recorder.transfer import Transfer
from rigd.engine.shared import RunFolder, leftovers
from rigd.model.errors import RecordingError
from rigd.record.file import RecordingInUse


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
    try:
        return _drain(folder)
    except RecordingInUse:
        raise  # whoever writes the recording may be that very run: nothing is to be removed
    except RecordingError as error:
        waiting = f"Samples of a killed run wait in {folder.path}; removing it gives them up."
        hint = waiting if error.hint is None else f"{error.hint}\n  {waiting}"
        raise RecordingError(error.message, hint=hint) from error


def _drain(folder: RunFolder) -> Path | None:
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


def drain_into(recording: Path, *, command: str) -> bool:
    """Put what a killed run left for ``recording`` into it; return whether there was anything.

    Raises:
        Blocked: that run is still under way.
        RecordingError: the recording cannot be written, or some run was left that cannot be
            read; everything stays as it is.
    """
    unreadable: RecordingError | None = None
    for found in leftovers():
        try:
            job = found.job
        except RecordingError as error:
            unreadable = error  # of whichever recording that is
            continue
        if job.recording.resolve() == recording.resolve():
            folder = RunFolder.take_at(found.path, job.rig, command, recording)
            try:
                return drain_leftovers(folder) is not None
            finally:
                folder.release()
    if unreadable is not None:
        raise unreadable
    return False
