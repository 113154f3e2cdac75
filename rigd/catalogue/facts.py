"""Makes of a recording the facts by which it is found, and the line that a list shows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

from rigd.catalogue.values import DATE, Value, value_of

if TYPE_CHECKING:
    from rigd.record import RunInfo

#: The fields that every folder has, with their meaning.
FIELDS: Final[Mapping[str, str]] = {
    "started": "when it was recorded, UTC",
    "procedure": "name of the procedure",
    "title": "title of the procedure",
    "rig": "name of the rig",
    "mode": "hardware, simulated at the wire, or simulated, virtual time",
    "state": "how the run ended: complete, stopped, interrupted",
    "reason": "why it ended",
    "verdict": "whether its measures are what the procedure demands",
    "trials": "number of complete trials",
    "planned": "number of trials of the procedure",
    "duration": "from the first to the last sample",
    "size": "of the file, in bytes",
    "file": "path below the folder",
    "operator": "who ran it",
    "note": "a note of the start, or a later one",
    "specimen": "name of the specimen",
    "condition": "valid if another program wrote the file",
}
#: Metadata whose values are facts as ``NAME.KEY``, by the name of the field.
_MAPS: Final = {
    "parameters": "parameter",
    "overrides": "set",
    "meta": "meta",
    "specimen": "specimen",
    "run": "run",
    "calibration": "calibration",
    "verdict": "verdict",
}
#: Own records of the file, and data for programs: no facts.
_LEFT_OUT: Final = frozenset({"identify", "rigd", "recovery", "notes"})
#: Longer texts are no facts, but for notes.
_MOST_LETTERS: Final = 300


class Fact(NamedTuple):
    """The value of a field; a field may have several."""

    field: str
    value: Value


@dataclass(frozen=True)
class Listing:
    """What a list shows of a recording; ``started`` in s since 1970 (UTC), from ``started_of``."""

    file: str
    started: float
    started_of: str
    procedure: str
    rig: str
    state: str
    trials: int
    planned: str
    duration_s: float | None
    size: int
    set: str
    specimen: str
    meta: str
    verdict: str
    note: str
    condition: str  #: "valid" if another program wrote the file; empty of those of rigd


def line_of(info: RunInfo, file: str) -> Listing:
    """Return the line of a recording, which is called ``file`` in its folder."""
    from rigd.record.read.moment import recorded_at

    moment = recorded_at(info)
    return Listing(
        file=file,
        started=moment.at.timestamp(),
        started_of=moment.of,
        procedure=info.procedure,
        rig=info.rig,
        state=info.state,
        trials=info.trials_done,
        planned=info.metadata.get("run", {}).get("trials", "?"),
        duration_s=info.took_s,
        size=info.size,
        set=assigned(info.metadata.get("overrides", {})),
        specimen=info.specimen.get("name", ""),
        meta=assigned(info.metadata.get("meta", {})),
        verdict=info.verdict,
        note=" / ".join(notes_of(info)),
        condition=condition_of(info),
    )


def condition_of(info: RunInfo) -> str:
    """Return what a list states of a file; nothing of one that rigd wrote: it is not checked."""
    return "" if info.foreign is None else str(info.condition)


def notes_of(info: RunInfo) -> list[str]:
    """Return the note of the start, that of a person who resumed it, and the later ones."""
    given = (info.metadata.get(part, {}).get("note", "") for part in ("run", "resumed"))
    return [*filter(None, given), *(note.text for note in info.notes)]


def facts_of(info: RunInfo, line: Listing) -> list[Fact]:
    """Return all facts of a recording, each once."""
    return list(dict.fromkeys(_facts(info, line)))


def _facts(info: RunInfo, line: Listing) -> Iterator[Fact]:
    run = info.metadata.get("run", {})
    texts = {
        "file": line.file, "procedure": info.procedure, "title": run.get("title", ""),
        "rig": info.rig, "mode": info.mode, "state": info.state, "reason": info.reason,
        "operator": run.get("operator", ""), "verdict": line.verdict,
        # Recordings that are older than --specimen have it in --meta.
        "condition": line.condition,
        "specimen": line.specimen or info.metadata.get("meta", {}).get("specimen", ""),
    }  # fmt: skip
    for name, text in texts.items():
        if text:
            yield Fact(name, Value(text, *value_of(text)[1:]))
    resumed_by = info.metadata.get("resumed", {}).get("operator", "")
    if resumed_by:
        yield Fact("operator", Value(resumed_by))
    for text in notes_of(info):
        yield Fact("note", Value(text))
    for note in info.notes:
        yield Fact("note.author", Value(note.author))
    yield Fact("started", Value(f"{line.started:.0f}", line.started, DATE))
    yield Fact("trials", value_of(str(line.trials)))
    if line.planned.isdecimal():
        yield Fact("planned", value_of(line.planned))
    if line.duration_s is not None:
        yield Fact("duration", Value(f"{line.duration_s:g} s", line.duration_s, "s"))
    yield Fact("size", value_of(str(info.size)))
    for trial in info.trials:
        for name in trial.parameters:
            text = trial.text(name)
            if text:
                yield Fact(f"parameter.{name}", value_of(text))
    for record, values in info.metadata.items():
        if record in _LEFT_OUT:
            continue
        for key, text in values.items():
            if text and len(text) <= _MOST_LETTERS:
                yield Fact(f"{_MAPS.get(record, record)}.{key}", value_of(text))


def assigned(values: Mapping[str, str]) -> str:
    """Return values by name as a list shows them: ``floor=pvc, load=2 N``."""
    return ", ".join(f"{key}={text}" for key, text in values.items())
