"""Numbers the events of a daemon and keeps the newest for clients that connect later."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Sequence
from itertools import islice
from typing import Any, Final

from rigd.record.events.event import Event as RecordedEvent
from rigd.record.events.event import data_to_json
from rigd.remote.protocol import VERSION, RigEvent

#: Events that are kept.
KEPT: Final = 1000
#: Bytes of an event's data as JSON; longer data are only in the recording.
MAX_DATA_BYTES: Final = 32 * 1024
#: Bytes of data in one answer, about; far below the limit of a message.
ANSWER_BYTES: Final = 256 * 1024


class EventLog:
    """Numbers events from 0 on."""

    def __init__(self) -> None:
        self._kept: deque[tuple[int, RigEvent]] = deque(maxlen=KEPT)  #: with the bytes of its data
        self.next = 0  #: number of the next event

    def add(self, event: RecordedEvent) -> RigEvent:
        """Number an event, and keep it.

        Raises:
            TypeError: its data has no form in JSON.
        """
        text = data_to_json(event.data)
        data: dict[str, Any] = json.loads(text)
        size = len(text.encode())
        if size > MAX_DATA_BYTES:
            data = {"left_out": f"{size} bytes, which the recording has"}
            size = len(data["left_out"])
        numbered = RigEvent(
            v=VERSION,
            seq=self.next,
            t_ns=event.t_ns,
            kind=event.kind,
            trial=event.trial,
            data=data,
        )
        self._kept.append((size, numbered))
        self.next += 1
        return numbered

    def since(self, number: int) -> Sequence[RigEvent]:
        """Return stored events from ``number`` on, oldest first: as many as one answer can contain.

        The first has a larger number if older events are no longer stored.
        """
        found: list[RigEvent] = []
        room = ANSWER_BYTES
        first = self.next - len(self._kept)
        for size, event in islice(self._kept, max(number - first, 0), None):
            room -= size
            if room < 0:
                break
            found.append(event)
        return found
