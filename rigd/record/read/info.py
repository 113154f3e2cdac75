"""Summarises a recording from its index, metadata and events; reads no sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rigd.model import Stream
from rigd.record.events.event import Event
from rigd.record.events.gaps import Gap, gap_text, gaps_json
from rigd.record.events.trials import INTERRUPTED, TrialInfo
from rigd.record.mcap.prefix import RECOVERY_METADATA
from rigd.record.read.condition import FileCondition, Foreign, foreign_json
from rigd.record.read.messages.topics import Topic
from rigd.record.read.notes import Note, notes_in

if TYPE_CHECKING:
    from rigd.config.lab.lab import Specimen
    from rigd.model.about import About

#: State where ``run_end`` names none.
COMPLETE: Final = "complete"
#: State of a file of another program that has no events of rigd.
NO_RUN: Final = "no run"
#: Metadata record of the specimen.
SPECIMEN_METADATA: Final = "specimen"
#: Metadata record of the verdict on the measures of a run, under ``verdict``.
VERDICT_METADATA: Final = "verdict"


@dataclass(frozen=True)
class StreamInfo:
    """A stream's number of rows and mean rate, which is 0 Hz if there are fewer than two rows."""

    stream: Stream
    rows: int
    rate_hz: float


@dataclass(frozen=True)
class RunInfo:
    """Summary of one recording."""

    path: Path
    procedure: str
    rig: str
    mode: str
    seed: str
    started: str  #: ISO 8601 as the engine wrote it; empty if unknown
    state: str  #: the state in ``run_end``, or :data:`INTERRUPTED`, or :data:`NO_RUN`
    reason: str
    recovered: bool  #: whether the file was torn and has been repaired
    problem: str  #: the first damage of the file, if it was opened as partial
    trials: tuple[TrialInfo, ...]
    streams: tuple[StreamInfo, ...]
    parameters: Mapping[str, str]
    attachments: tuple[str, ...]
    metadata: Mapping[str, Mapping[str, str]]
    start_ns: int  #: when the recording began, ns since the Unix epoch
    duration_s: float
    size: int  #: bytes
    gaps: tuple[Gap, ...] = ()  #: rows that are known to be lost
    topics: tuple[Topic, ...] = ()  #: of another program, which rigd cannot read as columns
    condition: FileCondition = FileCondition.UNCHECKED  #: what the file is
    foreign: Foreign | None = None  #: what is known of a file that another program wrote
    began: bool = True  #: whether preflight was passed, so that the rig was to be armed

    @property
    def took_s(self) -> float | None:
        """How long the run took; None if it ended before the rig was armed."""
        return self.duration_s if self.began else None

    @property
    def losses(self) -> tuple[str, ...]:
        """The damage and the losses, as sentences; empty if none is known."""
        lines = []
        if self.problem:
            lines.append(f"{self.path} is damaged; the damaged parts were skipped: {self.problem}")
        elif self.gaps and self.recovered:
            lines.append(f"{self.path} was damaged and has been recovered")
        lines += [f"{self.path} lacks {gap_text(gap, self.start_ns)}" for gap in self.gaps]
        lost = [f"trial {trial.number} ({trial.lost})" for trial in self.trials if trial.lost]
        if lost:
            lines.append(f"{self.path}: not complete for that reason: {', '.join(lost)}")
        return tuple(lines)

    @property
    def specimen(self) -> Mapping[str, str]:
        """The specimen's ``name`` and what its file says of it; empty if none was stated."""
        return self.metadata.get(SPECIMEN_METADATA, {})

    @property
    def notes(self) -> tuple[Note, ...]:
        """The notes that were added after the run, the oldest first."""
        return notes_in(self.metadata)

    @property
    def verdict(self) -> str:
        """Whether the measures were what the procedure demands, as `rigd run` found; or empty."""
        return self.metadata.get(VERDICT_METADATA, {}).get("verdict", "")

    @property
    def trials_done(self) -> int:
        """Number of trials that were completed, each counted once."""
        return len({trial.number for trial in self.trials if trial.complete})


def info_of(
    path: Path,
    metadata: Mapping[str, Mapping[str, str]],
    events: Sequence[Event],
    attempts: Sequence[TrialInfo],
    start_ns: int,
    end_ns: int,
    size: int,
) -> RunInfo:
    """Return the summary that metadata and events give: without streams and attachments."""
    run = metadata.get("run", {})
    state, reason = run_state(events)
    kinds = {event.kind for event in events}
    return RunInfo(
        path=path,
        procedure=run.get("procedure", ""),
        rig=run.get("rig", ""),
        mode=run.get("mode", ""),
        seed=run.get("seed", ""),
        started=run.get("started", ""),
        state=state,
        reason=reason,
        recovered=RECOVERY_METADATA in metadata,
        problem="",
        trials=tuple(attempts),
        streams=(),
        parameters=metadata.get("parameters", {}),
        attachments=(),
        metadata=metadata,
        start_ns=start_ns,
        duration_s=(end_ns - start_ns) * 1e-9,
        size=size,
        began="run_start" in kinds or "run_end" not in kinds,
    )


def info_json(info: RunInfo) -> dict[str, object]:
    """Return the summary as an object for ``json.dumps``."""
    return {
        "recording": str(info.path),
        "file": info.condition,
        **foreign_json(info.foreign),
        "bytes": info.size,
        "duration_s": info.duration_s,
        "procedure": info.procedure,
        "rig": info.rig,
        "mode": info.mode,
        "seed": info.seed,
        "started": info.started,
        "operator": info.metadata.get("run", {}).get("operator", ""),
        "note": info.metadata.get("run", {}).get("note", ""),
        "notes": [asdict(note) for note in info.notes],
        "verdict": info.verdict,
        "specimen": dict(info.specimen),
        "meta": dict(info.metadata.get("meta", {})),
        "state": info.state,
        "reason": info.reason,
        "recovered": info.recovered,
        "problem": info.problem,
        "lost_rows": gaps_json(info.gaps, info.start_ns),
        "parameters": dict(info.parameters),
        "calibration": dict(info.metadata.get("calibration", {})),
        "trials": [
            {
                "number": trial.number,
                "repeat": trial.repeat,
                "parameters": dict(trial.parameters),
                "units": dict(trial.units),
                "complete": trial.complete,
                "reason": trial.reason,
                "lost": trial.lost,
            }
            for trial in info.trials
        ],
        "streams": [
            {
                "name": stream.stream.name,
                "rows": stream.rows,
                "rate_hz": stream.rate_hz,
                "channels": {c.name: c.unit for c in stream.stream.channels},
            }
            for stream in info.streams
        ],
        "other_topics": list(dict.fromkeys(topic.topic for topic in info.topics)),
        "not_read": [asdict(topic) for topic in info.topics],
        "attachments": list(info.attachments),
    }


def run_state(events: Sequence[Event]) -> tuple[str, str]:
    """Return state and reason of a run; a resumed run is judged by its last part."""
    for event in reversed(events):
        if event.kind == "run_end":
            state = str(event.data.get("state") or COMPLETE)
            return state, str(event.data.get("reason") or "")
        if event.kind == "run_start":
            break
    return INTERRUPTED, ""


def stated_metadata(
    about: About, specimen: Specimen | None, run: dict[str, str]
) -> dict[str, dict[str, str]]:
    """Add operator and note to the metadata ``run``; return all else that is stated as metadata."""
    run.update({k: v for k, v in (("operator", about.operator), ("note", about.note)) if v})
    given = {"meta": dict(about.meta)}
    if specimen is not None and specimen.name:
        given[SPECIMEN_METADATA] = {"name": specimen.name, **specimen.fields}
    return {name: values for name, values in given.items() if values}
