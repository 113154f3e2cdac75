"""Makes the heading of a report: rig, procedure, recordings, dates, operator, notes and lost rows.

If recordings are simulated, the heading states it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rigd.analysis.report import Heading
from rigd.record import RunInfo
from rigd.record.read.moment import VIRTUAL, Moment, is_virtual, recorded_at

_DATE: Final = "%Y-%m-%d %H:%M UTC"
#: What gave the date of one recording, and of several.
_OF: Final = {
    "run": ("", ""),
    "file name": (" (by its file name)", " (by their file names)"),
    "file": (" (date of the file)", " (dates of the files)"),
}
#: Names that the heading has itself: a name of `--meta` that is one of these is marked as such.
_OWN: Final = frozenset({"rig", "procedure", "recording", "recordings", "recorded", "operator"})
#: So many recordings are named; of more, how many there are.
_NAMED: Final = 6
#: So many losses are named.
_LOSSES: Final = 12


def heading(infos: Sequence[RunInfo], made: datetime | None = None) -> Heading:
    """Return the heading of a report on the recordings ``infos``, made at ``made`` (now)."""
    return Heading(_badge(infos), tuple(_entries(infos, made)), _notes(infos), _losses(infos))


def _badge(infos: Sequence[RunInfo]) -> str:
    """Return in words that data are simulated; nothing if real devices gave all of them."""
    simulated = [info for info in infos if info.mode.startswith("simulated")]
    if not simulated:
        return ""
    if len(simulated) < len(infos):
        return f"{len(simulated)} of {len(infos)} recordings SIMULATED"
    modes = ", ".join(dict.fromkeys(info.mode for info in simulated))
    return modes.replace("simulated", "SIMULATED")


def _entries(infos: Sequence[RunInfo], made: datetime | None) -> Iterable[tuple[str, str]]:
    named = [info.path.name for info in infos]
    files = ", ".join(named) if len(named) <= _NAMED else f"{len(named)}, named under Provenance"
    several = len(infos) > 1
    yield from _line_of("Rig", (info.rig for info in infos))
    yield from _line_of("Procedure", (info.procedure for info in infos))
    yield ("Recordings" if several else "Recording", files)
    yield from _line_of("Imported from", (_original(info) for info in infos))
    times = (info.metadata.get("import", {}).get("times", "") for info in infos)
    yield from _line_of("Times in the files", times)
    yield from _line_of("Recorded", [_recorded(infos)])
    yield from _line_of("Operator", (_operator(info) for info in infos))
    specimens = [info.specimen.get("name", "") for info in infos]
    yield from _line_of("Specimen", specimens)
    for key in dict.fromkeys(key for info in infos for key in info.specimen if key != "name"):
        texts = (info.specimen.get(key, "") for info in infos)
        yield from _line_of(f"Specimen's {key}", texts)
    own = _OWN | {"specimen"} if any(specimens) else _OWN
    keys = dict.fromkeys(key for info in infos for key in info.metadata.get("meta", {}))
    for key in keys:
        name = f"{key} (--meta)" if key.casefold() in own else key
        yield from _line_of(name, (info.metadata.get("meta", {}).get(key, "") for info in infos))
    yield "Report made", (made or datetime.now(UTC)).astimezone(UTC).strftime(_DATE)


def _line_of(name: str, texts: Iterable[str]) -> Iterable[tuple[str, str]]:
    """Yield the texts of the recordings, each once; nothing if there are none."""
    found = [text for text in dict.fromkeys(texts) if text]
    if found:
        yield name, _some(found, "; ")


def _some(texts: Iterable[str], between: str) -> str:
    """Return all texts, or the first and the last of many."""
    found = list(texts)
    return between.join(found) if len(found) <= _NAMED else f"{found[0]} … {found[-1]}"


def _recorded(infos: Sequence[RunInfo]) -> str:
    """Return when the recordings were made, and from when their virtual time counts."""
    dates: dict[str, dict[str, None]] = {}
    virtual: dict[str, None] = {}
    for info in infos:
        try:
            moment: Moment = recorded_at(info)
        except OSError:
            continue
        dates.setdefault(moment.of, {})[moment.at.astimezone(UTC).strftime(_DATE)] = None
        if is_virtual(info):
            virtual[info.started[:10]] = None
    texts = [_some(found, ", ") + _OF[of][len(found) > 1] for of, found in dates.items()]
    since = [f"{VIRTUAL} from {_some(virtual, ', ')}"] if virtual else []
    return "; ".join([*texts, *since])


def _original(info: RunInfo) -> str:
    return info.metadata.get("run", {}).get("imported_from", "")


def _operator(info: RunInfo) -> str:
    first = info.metadata.get("run", {}).get("operator", "")
    second = info.metadata.get("resumed", {}).get("operator", "")
    if second and second != first:
        return f"{first or 'not named'}, resumed by {second}"
    return first


def _losses(infos: Sequence[RunInfo]) -> tuple[str, ...]:
    """Return what is lost, without folders: a page may be sent to others."""
    named = [replace(info, path=Path(info.path.name)) for info in infos]
    losses = [text for info in named for text in info.losses]
    if len(losses) > _LOSSES:
        more = f"and {len(losses) - _LOSSES} more: `rigd verify` lists them"
        return (*losses[:_LOSSES], more)
    return tuple(losses)


def _notes(infos: Sequence[RunInfo]) -> tuple[str, ...]:
    notes = []
    for info in infos:
        given = (info.metadata.get(part, {}).get("note", "") for part in ("run", "resumed"))
        before = f"{info.path.name}: " if len(infos) > 1 else ""
        texts = (*given, *map(str, info.notes))
        notes += [f"{before}{text}" for text in texts if text]
    return tuple(notes)
