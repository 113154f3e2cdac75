"""Memory that the processes of a run share: rings, board, and their folder.

Plain mapped files, ideally in memory (tmpfs). They outlive every process: what one of them has
put there is never lost because it, or any other, was killed.
"""

from rigd.engine.shared.board import Board, CycleState, Phase, RecorderState, Word
from rigd.engine.shared.eventring import EventRing, EventView
from rigd.engine.shared.folder import EVENT_SOURCES, InUse, RunFolder, leftovers, state_folder
from rigd.engine.shared.job import Job
from rigd.engine.shared.rowring import RowRing, View

__all__ = [
    "EVENT_SOURCES",
    "Board",
    "CycleState",
    "EventRing",
    "EventView",
    "InUse",
    "Job",
    "Phase",
    "RecorderState",
    "RowRing",
    "RunFolder",
    "View",
    "Word",
    "leftovers",
    "state_folder",
]
