"""Runs whose processes were killed: their recordings completed, and offered to be gone on with."""

from __future__ import annotations

import threading
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
        self._lock = threading.Lock()
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
                self._notices.note(f"{path.name} was torn and is repaired: {report.problem}")
        self.look()
        self._note_trips(trips)
        for one in self._found[:1]:
            self._notices.note(
                f"{one.run} ended after {one.trials_done} of {one.trials_total} trials "
                f"({one.reason}); resume_run goes on with it",
                "warning",
            )

    def look(self) -> None:
        """Look again which there are."""
        with self._lock:
            known = map(interrupted, self._recordings.of(self._rig))
            self._found = tuple(one for one in known if one is not None)[:OFFERED]

    def _note_trips(self, trips: TripMemory) -> None:
        """Remember what tripped in the last run after its daemon could no longer tell."""
        last = next(iter(self._recordings.of(self._rig)), None)
        if last is None or interrupted(last) is None:
            return
        events = Recording.open(last.path).events()
        known_ns = trips.known_ns
        trips.note(Acted.recorded(one) for one in events if _is_news(one, known_ns))


def _is_news(event: Event, known_ns: int) -> bool:
    return event.kind == "interlock" and event.t_ns > known_ns
