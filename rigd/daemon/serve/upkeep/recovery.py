"""Completes the recordings of killed runs and offers to resume these runs."""

from __future__ import annotations

import shutil
import time
from pathlib import Path
from typing import Final

from rigd.daemon.serve.recordings import Recordings, interrupted
from rigd.daemon.serve.upkeep.notices import Notices
from rigd.daemon.serve.upkeep.trips import RememberedTrip, TripMemory
from rigd.engine.recorder import drain_leftovers
from rigd.engine.shared import RunFolder
from rigd.model.errors import RecordingError
from rigd.record import Event, Recording, recover
from rigd.record.mcap.file import RecordingInUse
from rigd.remote.protocol.status import Interrupted

#: So many interrupted runs are offered, the newest.
OFFERED: Final = 10


class Interruptions:
    """The runs on ``rig`` that were interrupted."""

    def __init__(self, rig: str, recordings: Recordings, notices: Notices) -> None:
        self._rig, self._recordings, self._notices = rig, recordings, notices
        self._found: tuple[Interrupted, ...] = ()

    def views(self) -> tuple[Interrupted, ...]:
        """Return them, the newest first."""
        return self._found

    def recover(self, folder: RunFolder, trips: TripMemory) -> None:
        """Complete the recordings of killed runs, and return what they are.

        ``folder`` is that of the rig, held by this process. No failure here stops the daemon:
        recordings that cannot be completed are reported.
        """
        self.settle(folder)
        for path in self._recordings.unreadable():
            try:
                report = recover(path, others=False)
            except RecordingInUse:
                continue  # of another rig, still being written
            except RecordingError as error:
                self._notices.note(str(error), "warning")
            else:
                kept = f"; {report.original.name} is as it was" if report.original else ""
                self._notices.note(f"{path.name} was torn and is repaired: {report.problem}{kept}")
        runs = self._recordings.of(self._rig)
        offered = [found for run in runs if (found := interrupted(run)) is not None]
        self._found = tuple(offered[:OFFERED])
        if runs and interrupted(runs[0]) is not None:
            # Trips that happened after the daemon had been killed.
            events, known_ns = Recording.open(runs[0].path).events(), trips.known_ns
            trips.note(
                RememberedTrip.recorded(event) for event in events if _is_news(event, known_ns)
            )
        for item in offered[:1]:
            self._notices.note(
                f"{item.run} ended after {item.trials_done} of {item.trials_total} trials "
                f"({item.reason}); `rigd remote resume-run {item.run}` goes on with it",
                "warning",
            )

    def settle(self, folder: RunFolder) -> None:
        """Write the samples of an earlier run from memory to disk: before that, no run can begin.

        Samples of a removed recording are discarded; samples of another version of rigd are moved
        beside the recordings. Each case is reported.
        """
        try:
            completed = drain_leftovers(folder)
        except RecordingInUse as error:
            self._notices.note(f"a killed run cannot be completed: {error}", "error")
        except RecordingError as error:
            self._give_up(folder, error)
        else:
            if completed is not None:
                self._notices.note(
                    f"{completed.name}: samples that a killed run left in memory were added"
                )

    def _give_up(self, folder: RunFolder, error: RecordingError) -> None:
        try:
            recording = folder.job.recording
        except RecordingError:
            kept = _set_aside(folder, self._recordings.folder)
            self._notices.note(
                f"a run left samples that this version of rigd cannot read ({error.message}); "
                f"they are kept in {kept}",
                "error",
            )
            return
        if recording.exists():
            self._notices.note(f"a killed run cannot be completed: {error}", "error")
            return
        folder.clear()
        self._notices.note(
            f"{recording.name} was removed while it was recorded: the samples that its run left in "
            "memory are discarded",
            "warning",
        )

    def ended(self, run: str) -> None:
        """Look again at a run that has ended; ``run`` is its file, which may not be there."""
        others = tuple(item for item in self._found if item.run != run)
        offered = self._recordings.interrupted(run)
        self._found = others if offered is None else (offered, *others)[:OFFERED]


def _is_news(event: Event, known_ns: int) -> bool:
    return event.kind == "interlock" and event.t_ns > known_ns


def _set_aside(folder: RunFolder, runs: Path) -> Path:
    """Move the data of a run to a separate folder on the disk, and return the folder."""
    kept = runs / f"{folder.path.name}-left-{time.time_ns()}"
    try:
        kept.mkdir()
        for path in folder.remaining:
            shutil.move(path, kept)
    except OSError as error:
        raise RecordingError(
            f"cannot move the samples of a run from {folder.path} to {kept}: {error.strerror}",
            hint=f"make room, or remove {folder.path} to discard them",
        ) from error
    return kept
