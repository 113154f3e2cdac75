"""Provides the memory that the processes of a run share: rings, board, and the folder of both.

A run is one execution of a procedure on a rig. A ring is a buffer of fixed size that passes rows
(samples) or events from one process to another. The board holds the status words and the signs of
life of the processes. The folder also holds the lock of the rig and the job (the data with which
the recorder, the process that writes to disk, starts).

The memory consists of plain mapped files, ideally in tmpfs. The files remain when a process ends:
data that one process has written are never lost because that process or another one was killed.
"""

from rigd.engine.shared.board import Board, CycleState, Phase, RecorderState, Word
from rigd.engine.shared.eventring import EventRing, EventView
from rigd.engine.shared.folder import (
    EVENT_SOURCES,
    InUse,
    RunFolder,
    leftovers,
    served_rigs,
    state_folder,
)
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
    "served_rigs",
    "state_folder",
]
