"""Writes, reads, checks and recovers recordings, which are MCAP files with one run each.

Rows are written in bulk and read as columns. To export a recording, import
:mod:`rigd.record.export`.
"""

from rigd.record.events.event import NO_TRIAL, Event
from rigd.record.events.gaps import Gap
from rigd.record.events.trials import Step, TrialInfo, steps, trials
from rigd.record.mcap.prefix import Attachment
from rigd.record.read.info import RunInfo, StreamInfo, info_json
from rigd.record.read.notes import Note
from rigd.record.read.reader import Recording
from rigd.record.read.tables import Table
from rigd.record.read.trial import Trial, Trials
from rigd.record.repair.recover import RecoveryReport, recover
from rigd.record.repair.verify import Verification, verification_json, verify
from rigd.record.write.amend import add_metadata, add_note
from rigd.record.write.writer import RecordingWriter

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
