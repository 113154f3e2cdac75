"""A rig that is open but not armed delivers the rows of its devices."""

from __future__ import annotations

from typing import cast

import numpy as np

from rigd.config.loader import load_rig
from rigd.daemon.manual import UnarmedSession
from rigd.engine.cycle.wiring import streams_of
from rigd.engine.play.control import Control
from rigd.engine.process.process_host import ProcessHost
from rigd.engine.shared import RunFolder
from rigd.engine.sink import Rows
from rigd.model.rows import row_dtype

RIG = load_rig("lugre-1")
SPEED = row_dtype(next(stream for stream in streams_of(RIG) if stream.name == "carriage"))


class FilledRing:
    """A ring in which one row waits: the cycle pushed it before a device had given any."""

    def __init__(self) -> None:
        self.rows = np.zeros(1, SPEED)

    def drain(self) -> Rows:
        rows, self.rows = self.rows, self.rows[:0]
        return rows


class NoEvents:
    def drain(self) -> list[object]:
        return []


class FilledFolder:
    job = None

    def row_rings(self, job: object) -> dict[str, FilledRing]:
        return {"carriage": FilledRing()}

    def event_ring(self, source: str) -> NoEvents:
        return NoEvents()


class SettledHost:
    """A cycle of which every device has given a row; it drains no ring by itself."""

    t_ns = 0

    def settle(self, count: int) -> None:
        """The first rows have come."""

    def rest_while(self, condition: object) -> None:
        """The time has passed."""


def test_rows_before_the_first_are_not_surveyed() -> None:
    host, folder = cast("ProcessHost", SettledHost()), cast("RunFolder", FilledFolder())
    look = UnarmedSession(RIG, host, folder, Control())
    surveyed: list[str] = []
    look.first_rows()
    look.on_rows = lambda stream, _: surveyed.append(stream)
    look.rest(1.0)
    assert not surveyed
