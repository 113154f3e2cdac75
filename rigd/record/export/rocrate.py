"""Writes recordings as an RO-Crate: data, tables and their metadata, to be published with a DOI.

RO-Crate 1.2 (https://w3id.org/ro/crate/1.2): a folder, or a zip file, with a description in JSON-LD
(``ro-crate-metadata.json``) of what is in it, who made it, with which instrument and program, and
under which licence. The run is a ``CreateAction`` with the rig as its instrument, the specimen as
its object and the recording as its result; so is the export with rigd.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import re
import shutil
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any, Final, Literal
from urllib.parse import quote

from rigd import __version__
from rigd.config.lab.publication import Author, Publication
from rigd.model import RecordingError
from rigd.record.export import export
from rigd.record.export.part import Measures
from rigd.record.mcap.file import RecordingInUse
from rigd.record.read.attachments import file_names
from rigd.record.read.index import is_written
from rigd.record.read.info import RunInfo
from rigd.record.read.moment import is_virtual, recorded_at
from rigd.record.read.reader import Recording

SPECIFICATION: Final = "https://w3id.org/ro/crate/1.2"
METADATA_FILE: Final = "ro-crate-metadata.json"
#: A path that ends so is a zip file, any other a folder.
ZIP: Final = ".zip"
_BLOCK: Final = 1 << 20
_MEDIA: Final = {
    ".mcap": "application/octet-stream",
    ".csv": "text/csv",
    ".parquet": "application/vnd.apache.parquet",
    ".json": "application/json",
    ".yaml": "application/yaml",
}
#: What begins the name of an attachment: what it is.
_MEANING: Final = {
    "procedure.yaml": "Procedure that was run",
    "rig.yaml": "Description of the rig: devices, channels, limits, interlocks",
    "calibration.yaml": "Calibration of the rig that the run used",
    "specimen.yaml": "Description of the specimen",
    "import_map.yaml": "Meaning of the original files that the recording was imported from",
}

Entity = dict[str, Any]


@dataclass(frozen=True)
class Published:
    """A recording to publish, and what its procedure measures of each trial."""

    recording: Recording
    measures: Measures = field(default_factory=dict)


@dataclass
class _Crate:
    """The entities of a crate by their identifier, and its files by their path in it."""

    entities: dict[str, Entity] = field(default_factory=dict)
    files: dict[str, Path] = field(default_factory=dict)
    shared: dict[str, object] = field(default_factory=dict)

    def own(self, at: str, name: str, content: object) -> str:
        """Return ``at``, or with the recording's ``name`` if another's ``content`` is there."""
        known = self.shared.setdefault(at, content)
        return at if known == content else f"{at}@{_word(name)}"

    def add(self, at: str, type: str, /, **properties: Any) -> Entity:
        """Add an entity, or what is new of it; return the reference to it."""
        known = self.entities.setdefault(at, {"@id": at, "@type": type})
        for name, value in properties.items():
            is_single = isinstance(value, list) and len(value) == 1  # JSON-LD is compacted
            if value:
                known[name] = value[0] if is_single else value
        return {"@id": at}


def export_rocrate(
    sources: Sequence[Published],
    target: Path,
    publication: Publication,
    *,
    tables: Literal["csv", "parquet"] = "csv",
    published: date | None = None,
    overwrite: bool = False,
) -> Path:
    """Write recordings, their files and tables as one crate; return its path, ``target``.

    Raises:
        RecordingError: a recording is damaged or being written, ``target`` exists (unless
            ``overwrite``), or it cannot be written: then nothing is new or changed.
    """
    for source in sources:
        if is_written(source.recording.path):
            raise RecordingInUse(
                f"{source.recording.path} is being written", hint="Wait until its run has ended."
            )
        if source.recording.problem:
            raise RecordingError(
                f"{source.recording.path} is damaged: {source.recording.problem}",
                hint="what is published must be whole: `rigd recover` repairs what can be",
            )
    if target.exists() and not overwrite:
        raise RecordingError(f"{target} exists already", hint="--overwrite replaces it")
    if target.exists() and target.is_dir() != (target.suffix != ZIP):
        raise RecordingError(f"{target} is not what it would be replaced by")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as made:
            _write(sources, Path(made), target, publication, tables, published)
    except OSError as error:
        raise RecordingError(
            f"cannot export to {target}: {error.strerror or error}",
            hint="The disk may be full, the folder not yours, or a file open in another program.",
        ) from error
    return target


def _write(
    sources: Sequence[Published],
    folder: Path,
    target: Path,
    publication: Publication,
    tables: Literal["csv", "parquet"],
    published: date | None,
) -> None:
    """Make the crate in ``folder``, beside ``target``, and give it its name."""
    crate = _Crate()
    stage = folder / "crate"
    for author in publication.authors:  # before the operators, who may be authors with an ORCID iD
        _person(crate, author)
    named = dict(zip(_names(sources), sources, strict=True))
    actions = [_describe(crate, name, source, stage, tables) for name, source in named.items()]
    root = _root(crate, named, publication, published or datetime.now(UTC).date(), actions)
    _add_files(crate)
    root["hasPart"] = [{"@id": _identifier(name)} for name in sorted(crate.files)]
    about = {
        "@id": METADATA_FILE,
        "@type": "CreativeWork",
        "about": {"@id": "./"},
        "conformsTo": {"@id": SPECIFICATION},
    }
    document = {
        "@context": f"{SPECIFICATION}/context",
        "@graph": [about, *crate.entities.values()],
    }
    described = stage / METADATA_FILE
    described.write_text(json.dumps(document, indent=2, ensure_ascii=False) + "\n", "utf-8")
    crate.files[METADATA_FILE] = described
    if target.suffix == ZIP:
        packed = folder / "crate.zip"
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, path in sorted(crate.files.items()):
                packs = zipfile.ZIP_STORED if path.suffix == ".mcap" else zipfile.ZIP_DEFLATED
                archive.write(path, name, packs)
        packed.replace(target)
        return
    for name, path in crate.files.items():
        if stage not in path.parents:
            (stage / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, stage / name)
    if target.exists():  # --overwrite
        target.replace(folder / "before")
    stage.replace(target)


def _names(sources: Sequence[Published]) -> list[str]:
    """Return a name for each recording, of which no two are alike, nor as identifiers."""
    stems = [source.recording.path.stem for source in sources]
    words = [_word(stem) for stem in stems]
    taken = set(words)
    names = []
    for number, stem in enumerate(stems, 1):
        name = stem
        if words.count(_word(stem)) > 1:
            free = (f"{stem}_{at}" for at in itertools.count(number))
            name = next(item for item in free if _word(item) not in taken)
            taken.add(_word(name))
        names.append(name)
    return names


def _describe(
    crate: _Crate, name: str, source: Published, stage: Path, tables: Literal["csv", "parquet"]
) -> list[Entity]:
    """Add all that is from one recording; return its run and its export."""
    recording, info = source.recording, source.recording.info
    held = f"recordings/{name}.mcap"
    crate.files[held] = recording.path
    result = crate.add(
        _identifier(held),
        "File",
        name=f"Recording {name}",
        description="All samples, events and files of the run, raw values included: MCAP with "
        "ROS 2 messages (https://mcap.dev)",
        conformsTo={"@id": "https://mcap.dev/spec"},
    )
    crate.add("https://mcap.dev/spec", "CreativeWork", name="MCAP file format")
    files = _attached(crate, name, recording, stage)
    written = _tables(crate, name, source, stage, tables)
    run = _run(crate, name, info, recording, result, files)
    exported = crate.add(
        f"#export-{_word(name)}",
        "CreateAction",
        name=f"Export of {name} as tables",
        instrument=_software(crate, __version__),
        object=result,
        result=written,
    )
    return [run, exported]


def _run(
    crate: _Crate,
    name: str,
    info: RunInfo,
    recording: Recording,
    result: Entity,
    files: Mapping[str, Entity],
) -> Entity:
    """Add the run that made a recording: rig, specimen, operator, times, and how it ended."""
    metadata = info.metadata
    virtual = is_virtual(info)
    kind = "Product" if "simulated" in info.mode else "IndividualProduct"
    described = [part for part in ("rig.yaml", "calibration.yaml") if part in files]
    texts = [recording.attachments[part].data for part in described]
    rig = crate.add(
        crate.own(f"#rig-{_word(info.rig or 'unknown')}", name, (info.mode, described, texts)),
        kind,
        name=info.rig or "unknown rig",
        description=f"Test rig: {info.mode}" if info.mode else "Test rig",
        subjectOf=[files[part] for part in described],
    )
    software = metadata.get("run", {}).get("rigd_version", "")
    began = recorded_at(info)
    times = {}
    if began.of == "run" and not virtual:
        ended = datetime.fromtimestamp(recording.end_ns * 1e-9, UTC)
        times = {"startTime": began.at.isoformat(), "endTime": ended.isoformat()}
    state = f"{info.state}: {info.reason}" if info.reason else info.state
    words = [f"Mode: {info.mode or 'not stated'}.", f"Ended: {state}."]
    if virtual:
        words.append("The data are simulated; their times are not those of a clock.")
    words += [f"Note: {text}" for text in _notes(info)]
    given = [
        item
        for part in ("parameters", "meta")
        for item in _values(crate, f"#run-{_word(name)}/{part}", metadata.get(part, {}))
    ]
    return crate.add(
        f"#run-{_word(name)}",
        "CreateAction",
        name=f"Run {info.procedure or name} on {info.rig or 'an unknown rig'}",
        description=" ".join(words),
        instrument=[rig, _software(crate, software)],
        object=[
            *_specimen(crate, name, info, recording, files),
            *filter(None, [files.get("procedure.yaml")]),
        ],
        agent=[_person(crate, Author(operator)) for operator in operators_of([recording])],
        result=result,
        additionalProperty=given,
        **times,
    )


def _software(crate: _Crate, version: str) -> Entity:
    """Add a version of rigd; a ``SoftwareApplication`` must have an address, and rigd has none."""
    return crate.add(
        f"#rigd-{_word(version or 'unknown')}",
        "CreativeWork",
        name="rigd",
        version=version,
        description="Controller and data-acquisition daemon for friction test rigs",
    )


def _notes(info: RunInfo) -> list[str]:
    """Return the note of the start, that of a person who resumed it, and the later ones."""
    given = (info.metadata.get(part, {}).get("note", "") for part in ("run", "resumed"))
    return [*filter(None, given), *(str(note) for note in info.notes)]


def _specimen(
    crate: _Crate, name: str, info: RunInfo, recording: Recording, files: Mapping[str, Entity]
) -> list[Entity]:
    specimen = info.specimen.get("name", "")
    if not specimen:
        return []
    fields = {key: text for key, text in info.specimen.items() if key != "name"}
    described = recording.attachments.get("specimen.yaml")
    content = fields, described and described.data
    identifier = crate.own(f"#specimen-{_word(specimen)}", name, content)
    return [
        crate.add(
            identifier,
            "Product",
            name=specimen,
            description="Specimen",
            additionalProperty=_values(crate, identifier, fields),
            subjectOf=files.get("specimen.yaml"),
        )
    ]


def _values(crate: _Crate, of: str, values: Mapping[str, str]) -> list[Entity]:
    return [
        crate.add(f"{of}/{_word(name)}", "PropertyValue", name=name, value=text)
        for name, text in values.items()
    ]


def _attached(crate: _Crate, name: str, recording: Recording, stage: Path) -> dict[str, Entity]:
    """Write the files that a recording carries; return their entities by name."""
    found: dict[str, Entity] = {}
    for attached, own in file_names(recording.attachments).items():
        content, place = recording.attachments[attached], f"files/{name}/{own}"
        path = stage / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.data)
        crate.files[place] = path
        found[attached] = crate.add(
            _identifier(place),
            "File",
            name=f"{attached} of {name}",
            description=_MEANING.get(attached, "File that the run was made with"),
        )
    return found


def _tables(
    crate: _Crate, name: str, source: Published, stage: Path, tables: Literal["csv", "parquet"]
) -> list[Entity]:
    """Write the tables of a recording; return their entities."""
    recording = source.recording
    found: list[Entity] = []
    for path in export(recording, stage / "tables" / name, tables, measures=source.measures):
        place = path.relative_to(stage).as_posix()
        crate.files[place] = path
        stream = recording.streams.get(path.name.removesuffix(path.suffix).replace(".", "/"))
        said = "All times in s, all values in SI units; units in the head of the columns"
        found.append(
            crate.add(
                _identifier(place),
                "File",
                name=f"{path.name} of {name}",
                description=f"{stream.doc or 'Samples of a device'}. {said}" if stream else said,
            )
        )
    return found


def _root(
    crate: _Crate,
    named: Mapping[str, Published],
    publication: Publication,
    published: date,
    actions: Sequence[Sequence[Entity]],
) -> Entity:
    """Add the data set as a whole; return its entity."""
    infos = [source.recording.info for source in named.values()]
    titles = dict.fromkeys(
        info.metadata.get("run", {}).get("title") or info.procedure or info.path.stem
        for info in infos
    )
    rigs = ", ".join(dict.fromkeys(info.rig for info in infos if info.rig)) or "unknown rig"
    title = publication.title or f"{'; '.join(titles)} ({rigs})"
    count = "1 recording" if len(infos) == 1 else f"{len(infos)} recordings"
    modes = ", ".join(dict.fromkeys(info.mode or "mode not stated" for info in infos))
    crate.add(
        publication.license_url, "CreativeWork", name=publication.license,
        description=f"Licence {publication.license}",
    )  # fmt: skip
    crate.add(
        "./",
        "Dataset",
        name=title,
        description=publication.description or f"{title}: {count} of {rigs} ({modes}).",
        datePublished=published.isoformat(),
        license={"@id": publication.license_url},
        author=[_person(crate, author) for author in publication.authors],
        publisher=_organization(crate, publication.publisher),
        keywords=list(publication.keywords),
        identifier=publication.doi,
        variableMeasured=_variables(crate, named),
        mentions=[action for some in actions for action in some],
    )
    return crate.entities["./"]


def operators_of(recordings: Sequence[Recording]) -> list[str]:
    """Return who started recordings, or resumed them, each once."""
    names = (
        item.metadata.get(part, {}).get("operator", "")
        for item in recordings
        for part in ("run", "resumed")
    )
    return [name for name in dict.fromkeys(names) if name]


def _variables(crate: _Crate, named: Mapping[str, Published]) -> list[Entity]:
    """Add the channels of all recordings, each once; return them."""
    found: dict[str, Entity] = {}
    for of, source in named.items():
        for stream in source.recording.streams.values():
            for channel in stream.channels:
                name = f"{stream.name}.{channel.name}"
                content = channel.unit, channel.doc
                at = crate.own(f"#channel-{_word(name)}", of, content)
                found[at] = crate.add(
                    at,
                    "PropertyValue",
                    name=name,
                    unitText=channel.unit,
                    description=channel.doc,
                )
    return list(found.values())


def _person(crate: _Crate, author: Author) -> Entity:
    """Add a person; one without ORCID has an identifier in this crate alone."""
    same = [
        item["@id"]
        for item in crate.entities.values()
        if item["@type"] == "Person" and item["name"] == author.name
    ]
    new = author.orcid_url or f"#person-{_word(author.name)}"
    return crate.add(
        same[0] if same else new,
        "Person",
        name=author.name,
        affiliation=_organization(crate, author.affiliation),
    )


def _organization(crate: _Crate, name: str) -> Entity | None:
    return crate.add(f"#organization-{_word(name)}", "Organization", name=name) if name else None


def _add_files(crate: _Crate) -> None:
    """Add size, hash and kind of each file."""
    for name, path in crate.files.items():
        digest = hashlib.sha256()
        size = 0
        with path.open("rb") as file:
            while block := file.read(_BLOCK):
                digest.update(block)
                size += len(block)
        media = _MEDIA.get(path.suffix, "application/octet-stream")
        crate.add(
            _identifier(name),
            "File",
            contentSize=str(size),
            sha256=digest.hexdigest(),
            encodingFormat=media,
        )


def _identifier(path: str) -> str:
    """Return a path in the crate as a URI."""
    return quote(path)


def _word(name: str) -> str:
    """Return a name as a part of an identifier."""
    return quote(re.sub(r"\s+", "_", name), safe="")
