"""Writes, reads, checks and recovers recordings, which are MCAP files with one run each.

Rows are written in bulk and read as columns. To export a recording, import
:mod:`rigd.record.export`.
"""

from rigd.record.amend import add_metadata, add_note
from rigd.record.events import NO_TRIAL, Event
from rigd.record.gaps import Gap
from rigd.record.info import RunInfo, StreamInfo, info_json
from rigd.record.notes import Note
from rigd.record.prefix import Attachment
from rigd.record.reader import Recording
from rigd.record.recover import RecoveryReport, recover
from rigd.record.tables import Table
from rigd.record.trial import Trial, Trials
from rigd.record.trials import Step, TrialInfo, steps, trials
from rigd.record.verify import Verification, verification_json, verify
from rigd.record.writer import RecordingWriter

__all__ = [
    "NO_TRIAL",
    "Attachment",
    "Event",
    "Gap",
    "Note",
    "Recording",
    "RecordingWriter",
    "RecoveryReport",
    "RunInfo",
    "Step",
    "StreamInfo",
    "Table",
    "Trial",
    "TrialInfo",
    "Trials",
    "Verification",
    "add_metadata",
    "add_note",
    "info_json",
    "recover",
    "steps",
    "trials",
    "verification_json",
    "verify",
]
