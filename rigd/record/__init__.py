"""Recordings: MCAP files written in bulk, read as columns, recovered in place, exported."""

from rigd.record.events import NO_TRIAL, Event
from rigd.record.prefix import Attachment
from rigd.record.reader import Recording
from rigd.record.recover import RecoveryReport, recover
from rigd.record.writer import RecordingWriter

__all__ = [
    "NO_TRIAL",
    "Attachment",
    "Event",
    "Recording",
    "RecordingWriter",
    "RecoveryReport",
    "recover",
]
