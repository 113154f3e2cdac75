"""Runs whose processes were killed: their recordings completed, and offered to be gone on with."""

from __future__ import annotations

from typing import Final

from rigd.daemon.serve.notices import Notices
from rigd.daemon.serve.recordings import Recordings, interrupted
from rigd.daemon.serve.trips import Acted, TripMemory
from rigd.engine.recorder import drain_leftovers
from rigd.engine.shared import RunFolder
from rigd.model.errors import RecordingError
from rigd.record import Event, Recording, recover
from rigd.record.file import InUse
from rigd.remote.protocol.status import Interrupted

#: So many are offered, the newest.
OFFERED: Final = 10


class Interruptions:
    """The runs on ``rig`` that did not come to an end of their own."""

    def __init__(self, rig: str, recordings: Recordings, notices: Notices) -> None:
        self._rig, self._recordings, self._notices = rig, recordings, notices
        self._found: tuple[Interrupted, ...] = ()

    def views(self) -> tuple[Interrupted, ...]:
        """Return them, the newest first."""
        return self._found

    def recover(self, folder: RunFolder, trips: TripMemory) -> None:
        """Complete what killed runs have left, and find what they are.

        ``folder`` is that of the rig, held by this process. Nothing here keeps the daemon from
        serving: what cannot be completed is told.
        """
        try:
            completed = drain_leftovers(folder)
        except RecordingError as error:
            self._notices.note(f"a killed run cannot be completed: {error}", "error")
        else:
            if completed is not None:
                self._notices.note(f"{completed.name}: what a killed run left in memory was added")
        for path in self._recordings.unreadable():
            try:
                report = recover(path)
            except InUse:
                continue  # another's, under way
            except RecordingError as error:
                self._notices.note(str(error), "warning")
            else:
                kept = f"; {report.original.name} is as it was" if report.original else ""
                self._notices.note(f"{path.name} was torn and is repaired: {report.problem}{kept}")
        runs = self._recordings.of(self._rig)
        offered = [one for run in runs if (one := interrupted(run)) is not None]
        self._found = tuple(offered[:OFFERED])
        if runs and interrupted(runs[0]) is not None:
            # What tripped after the daemon could no longer tell.
            events, known_ns = Recording.open(runs[0].path).events(), trips.known_ns
            trips.note(Acted.recorded(one) for one in events if _is_news(one, known_ns))
        for one in offered[:1]:
            self._notices.note(
                f"{one.run} ended after {one.trials_done} of {one.trials_total} trials "
                f"({one.reason}); `rigd remote resume-run {one.run}` goes on with it",
                "warning",
            )

    def ended(self, run: str) -> None:
        """Look again at a run that has ended; ``run`` is its file, which may not be there."""
        others = tuple(one for one in self._found if one.run != run)
        offered = self._recordings.interrupted(run)
        self._found = others if offered is None else (offered, *others)[:OFFERED]


def _is_news(event: Event, known_ns: int) -> bool:
    return event.kind == "interlock" and event.t_ns > known_ns
