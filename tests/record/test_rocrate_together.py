"""A crate of several recordings keeps apart what has one name and differs."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from rigd.config.lab.publication import Author, Publication
from rigd.model import Channel, Stream
from rigd.record import Attachment, Recording, RecordingWriter
from rigd.record.export.rocrate import Published, export_rocrate

Record = Callable[..., Recording]
Graph = Mapping[str, Mapping[str, Any]]
PAD = {"name": "pad A", "mass": "1 kg"}


@pytest.fixture
def record(tmp_path: Path, create: Callable[..., RecordingWriter]) -> Record:
    """Records nothing but its metadata; the channel ``f`` is in ``unit``."""

    def make(name: str, *, rig: str = "", unit: str = "N", **metadata: Any) -> Recording:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        run = {"rig": "tri", "mode": "hardware", **metadata.pop("run", {})}
        files = (Attachment("rig.yaml", "application/yaml", rig.encode()),) if rig else ()
        streams = (Stream("cell", (Channel("f", unit),)),)
        given = {"run": run, **metadata}
        create(name, streams=streams, metadata=given, attachments=files).close()
        return Recording.open(path)

    return make


def published(tmp_path: Path, *recordings: Recording, author: Author | None = None) -> Graph:
    publication = Publication("CC-BY-4.0", authors=(author or Author("Ada"),))
    sources = [Published(recording) for recording in recordings]
    crate = export_rocrate(sources, tmp_path / "crate", publication)
    graph = json.loads((crate / "ro-crate-metadata.json").read_text())["@graph"]
    return {item["@id"]: item for item in graph}


def test_rigs_of_one_name_that_differ_stay(tmp_path: Path, record: Record) -> None:
    simulated = {"mode": "simulated, virtual time"}
    graph = published(
        tmp_path,
        record("a.mcap", rig="rig: tri\n"),
        record("b.mcap", rig="rig: tri\n", run=simulated),
        record("c.mcap", rig="rig: tri\n"),
    )
    rigs = [graph[graph[f"#run-{name}"]["instrument"][0]["@id"]] for name in "abc"]
    assert [rig["@type"] for rig in rigs] == ["IndividualProduct", "Product", "IndividualProduct"]
    assert rigs[0] is rigs[2]


def test_specimens_of_one_name_that_differ_stay(tmp_path: Path, record: Record) -> None:
    graph = published(
        tmp_path,
        record("a.mcap", specimen=PAD),
        record("b.mcap", specimen={**PAD, "mass": "0.9 kg"}),
    )
    pads = [graph[graph[f"#run-{name}"]["object"]["@id"]] for name in "ab"]
    masses = [graph[pad["additionalProperty"]["@id"]]["value"] for pad in pads]
    assert masses == ["1 kg", "0.9 kg"]
    assert [pad["name"] for pad in pads] == ["pad A", "pad A"]


def test_channels_keep_units_that_differ(tmp_path: Path, record: Record) -> None:
    graph = published(tmp_path, record("a.mcap"), record("b.mcap", unit="V"), record("c.mcap"))
    channels = [graph[item["@id"]] for item in graph["./"]["variableMeasured"]]
    assert [(item["name"], item["unitText"]) for item in channels] == [
        ("cell.f", "N"), ("cell.f", "V"),
    ]  # fmt: skip


def test_parameter_and_statement_of_one_name_stay(tmp_path: Path, record: Record) -> None:
    recording = record("a.mcap", parameters={"load": "5 N"}, meta={"load": "about 5"})
    graph = published(tmp_path, recording)
    given = [graph[item["@id"]] for item in graph["#run-a"]["additionalProperty"]]
    assert [(item["name"], item["value"]) for item in given] == [
        ("load", "5 N"), ("load", "about 5"),
    ]  # fmt: skip


def test_operator_who_is_author_keeps_orcid(tmp_path: Path, record: Record) -> None:
    author = Author("Ada Lovelace", "0000-0002-1825-0097", "TU Graz")
    graph = published(tmp_path, record("a.mcap", run={"operator": "Ada Lovelace"}), author=author)
    assert graph["./"]["author"]["@id"] == author.orcid_url
    assert graph["#run-a"]["agent"]["@id"] == author.orcid_url


def test_resumed_run_has_both_operators_and_notes(tmp_path: Path, record: Record) -> None:
    recording = record(
        "a.mcap",
        run={"operator": "Ada", "note": "new belt"},
        resumed={"operator": "Bob", "note": "belt was dry"},
    )
    graph = published(tmp_path, recording)
    run = graph["#run-a"]
    assert [graph[item["@id"]]["name"] for item in run["agent"]] == ["Ada", "Bob"]
    assert "Note: new belt Note: belt was dry" in run["description"]


def test_names_are_unique_beside_numbered_ones(tmp_path: Path, record: Record) -> None:
    names = ("a/x.mcap", "b/x.mcap", "c/x_1.mcap", "c/my run.mcap", "c/my_run.mcap")
    graph = published(tmp_path, *map(record, names))
    files = [name for name in graph if name.startswith("recordings/")]
    assert len(files) == 5
    assert len([name for name in graph if name.startswith("#run-")]) == 5
