"""Recovers the samples in the rings of a run whose processes were all killed."""

from __future__ import annotations

from pathlib import Path

from rigd.engine.recorder.transfer import Transfer
from rigd.engine.shared import RunFolder, leftovers
from rigd.model.errors import RecordingError
from rigd.record.mcap.file import RecordingInUse


def drain_leftovers(folder: RunFolder) -> Path | None:
    """Write the samples that an earlier run left in ``folder`` to its recording; clear the folder.

    The folder must be held (:meth:`RunFolder.take`): then no process pushes any more. Returns the
    recording, or None if there were no samples. The run is marked interrupted, unless its end is
    among the samples.

    Raises:
        RecordingError: the recording cannot be written; everything stays as it is.
    """
    if not folder.has_job:
        folder.clear()
        return None
    try:
        return _drain(folder)
    except RecordingInUse:
        raise  # that run may be writing the recording: do not advise to remove the folder
    except RecordingError as error:
        waiting = f"Samples of a killed run wait in {folder.path}; to discard them, remove it."
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


def drain_into(recording: Path, *, command: str, held: RunFolder | None = None) -> bool:
    """Write what a killed run left for ``recording`` to it; return whether there was anything.

    ``held`` is the folder of a rig that this process holds already.

    Raises:
        Blocked: that run is still in progress.
        RecordingError: the recording cannot be written, or the data of some run cannot be
            read; everything stays as it is.
    """
    unreadable: RecordingError | None = None
    for found in leftovers():
        try:
            job = found.job
        except RecordingError as error:
            unreadable = error  # of any recording
            continue
        if job.recording.resolve() == recording.resolve():
            if held is not None and held.path == found.path:
                return drain_leftovers(held) is not None
            folder = RunFolder.take_at(found.path, job.rig, command, recording)
            try:
                return drain_leftovers(folder) is not None
            finally:
                folder.release()
    if unreadable is not None:
        raise unreadable
    return False
