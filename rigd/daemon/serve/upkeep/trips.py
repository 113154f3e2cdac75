"""Keeps the trips of interlocks (each time an interlock acts) until a person acknowledges them.

No run starts while a trip waits for acknowledgement that was latched or that ended a run. This also
holds after a restart of the daemon. This module does not check whether the cause of a trip is still
present: each run checks this at rest, before it arms anything.
"""

from __future__ import annotations

import json
import logging
import os
import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, cast

from rigd.engine.play.interlocks import Trip
from rigd.model.errors import RecordingError
from rigd.model.severity import Severity
from rigd.record import Event
from rigd.remote.protocol import Code, Refusal
from rigd.remote.protocol.status import ActionName, TripView

_LOG: Final = logging.getLogger(__name__)

#: Times of one trip differ by less: a number of a browser is exact to 256 ns.
_SAME_NS: Final = 1_000


@dataclass(frozen=True)
class RememberedTrip:
    """The newest trip of an interlock.

    ``bars`` is whether it blocks every start until it is acknowledged; ``by`` is the client that
    acknowledged it, or "".
    """

    interlock: str
    action: str
    message: str
    since_ns: int
    bars: bool
    by: str = ""

    @classmethod
    def of(cls, trip: Trip) -> RememberedTrip:
        """Return the stored form of a trip of the run in progress."""
        reasons = [trip.reason, trip.message]
        return cls(
            trip.interlock.name,
            trip.interlock.action.word,
            " - ".join(filter(None, reasons)),
            trip.t_ns,
            _bars(trip.interlock.action, latched=trip.interlock.latch),
        )

    @classmethod
    def recorded(cls, event: Event) -> RememberedTrip:
        """Return the stored form of a trip in a recording."""
        data = event.data
        reasons = [str(data["reason"]), str(data["message"])]
        action = Severity[str(data["action"]).upper()]
        return cls(
            str(data["name"]),
            str(data["action"]),
            " - ".join(filter(None, reasons)),
            event.t_ns,
            _bars(action, latched=bool(data["latched"])),
        )

    @property
    def view(self) -> TripView:
        """As the status shows it."""
        return TripView(
            interlock=self.interlock,
            action=cast(ActionName, self.action),
            message=self.message,
            since_ns=self.since_ns,
            latched=self.bars,
            acknowledged=bool(self.by),
        )


def _bars(action: Severity, *, latched: bool) -> bool:
    """Return whether a person must look first: it ended a run, or the rig file requires it."""
    return latched or action >= Severity.STOP


class TripMemory:
    """Keeps the newest trip of each interlock in a file.

    :meth:`note` never waits: it may be called from the thread that plays a run. :meth:`save` then
    writes the file.
    """

    def __init__(self, path: Path) -> None:
        """Read the file, if it exists.

        Raises:
            RecordingError: it cannot be read.
        """
        self._path = path
        self._lock = threading.Lock()  #: never held during an access to the disk
        self._saving = threading.Lock()
        self._changed = False
        self._acted: dict[str, RememberedTrip] = {}
        #: Trips up to this time are known; Unix ns.
        self.known_ns = 0
        if path.exists():
            self._read()

    def note(self, trips: Iterable[RememberedTrip]) -> None:
        """Store trips; for each interlock only the newest trip."""
        with self._lock:
            for trip in trips:
                self._acted[trip.interlock] = trip
                self.known_ns = max(self.known_ns, trip.since_ns)
                self._changed = True

    def acknowledge(self, interlock: str, who: str, since_ns: int | None = None) -> None:
        """Acknowledge the interlock, so that it no longer blocks a start.

        ``since_ns`` is the time of the trip that the client has seen; None: any.

        Raises:
            Refusal: it has not tripped, is acknowledged already, or has tripped again since.
        """
        with self._lock:
            known = self._acted.get(interlock)
            if known is None or known.by:
                raise Refusal(Code.CONFLICT, f"{interlock} has nothing to acknowledge")
            if since_ns is not None and known.since_ns - since_ns > _SAME_NS:
                raise Refusal(
                    Code.CONFLICT,
                    f"{interlock} has tripped again since: {known.message}",
                    hint="look at the rig once more, then acknowledge this trip",
                )
            self._acted[interlock] = replace(known, by=who)
            self._changed = True
        self.save()

    def begin_run(self) -> None:
        """Forget trips that are acknowledged, or that block nothing.

        Raises:
            Refusal: a trip still waits to be acknowledged.
        """
        with self._lock:
            barring = [item for item in self._acted.values() if item.bars and not item.by]
            if barring:
                names = ", ".join(item.interlock for item in barring)
                raise Refusal(
                    Code.REFUSED,
                    f"{names} tripped: {barring[0].message}",
                    hint="look at the rig, then acknowledge each (`rigd remote ack INTERLOCK`)",
                )
            self._changed = self._changed or bool(self._acted)
            self._acted.clear()
        self.save()

    def views(self) -> tuple[TripView, ...]:
        """Return the stored trips, the newest first."""
        with self._lock:
            known = sorted(self._acted.values(), key=lambda item: -item.since_ns)
        return tuple(item.view for item in known)

    def save(self) -> None:
        """Write changes to disk, whole or not at all; a failure is logged, and repeated later.

        The file keeps trips across a restart; while this process runs, its memory is enough.
        """
        with self._saving:
            with self._lock:
                if not self._changed:
                    return
                self._changed = False
                known = {
                    "known_ns": self.known_ns,
                    "trips": [asdict(item) for item in self._acted.values()],
                }
            draft = self._path.with_name(f"{self._path.name}.new")
            try:
                with draft.open("w") as file:
                    json.dump(known, file, indent=1)
                    file.flush()
                    os.fsync(file.fileno())
                draft.replace(self._path)
            except OSError as error:
                self._changed = True
                _LOG.warning("%s cannot be written: %s", self._path, error.strerror)

    def _read(self) -> None:
        try:
            held: Mapping[str, Any] = json.loads(self._path.read_bytes())
            self.known_ns = int(held["known_ns"])
            trips: Sequence[Mapping[str, Any]] = held["trips"]
            self._acted = {trip["interlock"]: RememberedTrip(**trip) for trip in trips}
        except OSError as error:
            raise RecordingError(f"cannot read {self._path}: {error.strerror}") from error
        except (KeyError, TypeError, ValueError) as error:
            raise RecordingError(
                f"{self._path} is no list of trips: {error!r}",
                hint="look at the rig, then remove it",
            ) from error
