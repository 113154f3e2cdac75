"""A published recording is a valid RO-Crate, as a reader of others finds it."""

from __future__ import annotations

import csv
import hashlib
import json
import zipfile
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rocrate.rocrate import ROCrate

from rigd.cli.main import main
from rigd.config.lab.publication import Author, Publication
from rigd.model import Channel, RecordingError, Stream
from rigd.model.rows import row_dtype
from rigd.record import Attachment, Recording, RecordingWriter, add_note
from rigd.record.export import rocrate
from rigd.record.export.rocrate import Published, export_rocrate

ADA = "0000-0002-1825-0097"
CARRIAGE = Stream("carriage", (Channel("position", "m", "of the wheel"),), doc="linear encoder")
RUN = {
    "procedure": "wear", "title": "Wear on one specimen", "rig": "bench 1", "mode": "hardware",
    "started": "2026-03-04T10:00:00+00:00", "trials": "1", "operator": "A. Miller",
    "note": "new coating", "rigd_version": "0.1.0",
}  # fmt: skip
START_NS = 1_772_618_400_000_000_000
PUBLICATION = Publication("CC-BY-4.0", authors=(Author("Ada Lovelace", ADA, "TU Graz"),))

Record = Callable[..., Path]


@pytest.fixture
def record(tmp_path: Path) -> Record:
    """Writes a short recording with a specimen and the files it was made from."""

    def make(name: str = "wear.mcap", **run: str) -> Path:
        rows = np.zeros(3, row_dtype(CARRIAGE))
        rows["t_ns"] = START_NS + np.arange(3) * 10**9
        files = {
            "procedure.yaml": "procedure: wear\n", "rig.yaml": "rig: bench\n",
            "calibration.yaml": "calibration: bench\n", "specimen.yaml": "specimen: W9\n",
        }  # fmt: skip
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        with RecordingWriter.create(
            path,
            streams=[CARRIAGE],
            metadata={
                "run": {**RUN, **run},
                "parameters": {"load": "5 N"},
                "specimen": {"name": "W9", "coating": "PTFE"},
            },
            attachments=[
                Attachment(name, "application/yaml", text.encode()) for name, text in files.items()
            ],
            start_ns=START_NS,
            sync_interval_s=None,
        ) as writer:
            writer.event(START_NS, "run_start")
            writer.event(START_NS, "trial_start", 1, {"repeat": 1, "parameters": {}})
            writer.write("carriage", rows)
            writer.event(START_NS + 2 * 10**9, "trial_end", 1, {"complete": True})
            writer.event(START_NS + 2 * 10**9, "run_end", None, {"state": "complete"})
        return path

    return make


def publish(path: Path, target: Path, **options: Any) -> ROCrate:
    """Export a recording; return the crate as its reader finds it."""
    given = {"published": date(2026, 11, 27), **options}
    return ROCrate(export_rocrate([Published(Recording.open(path))], target, PUBLICATION, **given))


def one(crate: ROCrate, kind: str) -> Any:
    (found,) = [item for item in crate.get_entities() if item.type == kind]
    return found


@pytest.mark.parametrize("name", ["crate", "wear.crate.zip"])
def test_reader_of_others_finds_all_files(tmp_path: Path, record: Record, name: str) -> None:
    path = record()
    crate = publish(path, tmp_path / name)
    listed = {item.id for item in crate.root_dataset["hasPart"]}
    if name.endswith(".zip"):
        with zipfile.ZipFile(tmp_path / name) as archive:
            assert archive.testzip() is None
            held = {item: archive.read(item) for item in archive.namelist()}
    else:
        root = tmp_path / name
        held = {
            item.relative_to(root).as_posix(): item.read_bytes()
            for item in root.rglob("*")
            if item.is_file()
        }
    assert set(held) == listed | {"ro-crate-metadata.json"}
    assert held["recordings/wear.mcap"] == path.read_bytes()
    assert held["files/wear/rig.yaml"] == b"rig: bench\n"
    assert {"tables/wear/carriage.csv", "tables/wear/trials.csv"} <= listed
    for item in listed:
        entity = crate.dereference(item)
        assert entity["sha256"] == hashlib.sha256(held[item]).hexdigest()
        assert int(entity["contentSize"]) == len(held[item])
        assert "/" in entity["encodingFormat"]
    rows = list(csv.reader(held["tables/wear/carriage.csv"].decode().splitlines()))
    assert len(rows) == 4


def test_crate_states_what_a_doi_demands(tmp_path: Path, record: Record) -> None:
    crate = publish(record(), tmp_path / "crate")
    root = crate.root_dataset
    assert root["name"] == "Wear on one specimen (bench 1)"
    assert root["datePublished"] == "2026-11-27"
    assert root["license"].id == "https://creativecommons.org/licenses/by/4.0/"
    author = root["author"]
    assert (author.id, author["name"]) == (f"https://orcid.org/{ADA}", "Ada Lovelace")
    assert author["affiliation"]["name"] == "TU Graz"
    assert "bench 1" in root["description"]
    channel = root["variableMeasured"]
    assert (channel["name"], channel["unitText"]) == ("carriage.position", "m")


def test_run_has_rig_specimen_operator_and_software(tmp_path: Path, record: Record) -> None:
    path = record()
    add_note(path, "the wheel was worn", "B. Klein")
    crate = publish(path, tmp_path / "crate")
    run = crate.dereference("#run-wear")
    assert run.type == "CreateAction"
    assert (run["startTime"], run["endTime"]) == (
        "2026-03-04T10:00:00+00:00", "2026-03-04T10:00:02+00:00",
    )  # fmt: skip
    assert run["agent"]["name"] == "A. Miller"
    assert run["result"].id == "recordings/wear.mcap"
    rig, software = run["instrument"]
    assert (rig.type, rig["name"]) == ("IndividualProduct", "bench 1")
    assert {item.id for item in rig["subjectOf"]} == {
        "files/wear/rig.yaml", "files/wear/calibration.yaml",
    }  # fmt: skip
    assert (software["name"], software["version"]) == ("rigd", "0.1.0")
    specimen, procedure = run["object"]
    assert specimen["name"] == "W9"
    stated = specimen["additionalProperty"]
    assert (stated["name"], stated["value"]) == ("coating", "PTFE")
    assert procedure.id == "files/wear/procedure.yaml"
    assert "new coating" in run["description"]
    assert "the wheel was worn" in run["description"]
    assert crate.dereference("#export-wear")["object"].id == "recordings/wear.mcap"


def test_simulated_run_states_no_time_of_a_clock(tmp_path: Path, record: Record) -> None:
    crate = publish(record(mode="simulated, virtual time"), tmp_path / "crate")
    run = crate.dereference("#run-wear")
    assert "startTime" not in run.properties()
    assert "The data are simulated" in run["description"]
    assert "simulated" in crate.root_dataset["description"]
    assert run["instrument"][0].type == "Product"  # not an individual one


def test_every_reference_in_a_crate_is_described(tmp_path: Path, record: Record) -> None:
    paths = [record(), record("monday/wear.mcap")]
    target = export_rocrate(
        [Published(Recording.open(path)) for path in paths], tmp_path / "both", PUBLICATION
    )
    graph = json.loads((target / "ro-crate-metadata.json").read_text())["@graph"]
    known = [item["@id"] for item in graph]
    assert len(known) == len(set(known))

    def used(value: Any) -> set[str]:
        if isinstance(value, dict):
            return (
                {value["@id"]} if set(value) == {"@id"} else set().union(*map(used, value.values()))
            )
        return set().union(*map(used, value)) if isinstance(value, list) else set()

    assert used(graph) - set(known) == {"https://w3id.org/ro/crate/1.2"}
    assert used(graph) >= set(known) - {"ro-crate-metadata.json"}
    assert {"recordings/wear_1.mcap", "recordings/wear_2.mcap"} <= set(known)


def test_failed_export_leaves_nothing(
    tmp_path: Path, record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = record()
    before = set(tmp_path.iterdir())

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(rocrate, "_add_files", full)
    with pytest.raises(RecordingError, match="No space left"):
        publish(path, tmp_path / "crate.zip")
    assert set(tmp_path.iterdir()) == before


def test_damaged_recording_is_not_published(tmp_path: Path, record: Record) -> None:
    path = record()
    path.write_bytes(path.read_bytes()[:-50])
    source = Published(Recording.open(path, partial=True))
    with pytest.raises(RecordingError, match="is damaged"):
        export_rocrate([source], tmp_path / "crate", PUBLICATION)
    assert not (tmp_path / "crate").exists()


def test_command_takes_the_publication_of_lab(
    tmp_path: Path, record: Record, capsys: pytest.CaptureFixture[str]
) -> None:
    lab = tmp_path / "lab.yaml"
    lab.write_text(
        "lab: tribology\nfields: {}\npublication:\n  license: CC0-1.0\n  publisher: TU Graz\n"
        f"  keywords: [friction]\n  authors:\n    - {{name: Ada Lovelace, orcid: {ADA}}}\n"
    )
    path = record()
    said = ["export", str(path), "--to", "rocrate", "--lab", str(lab)]
    assert main([*said, "--tables", "parquet", "--doi", "10.5281/zenodo.1234567"]) == 0
    target = Path(capsys.readouterr().out.strip())
    assert target == tmp_path / "wear.crate.zip"
    root = ROCrate(target).root_dataset
    assert root["identifier"] == "https://doi.org/10.5281/zenodo.1234567"
    assert root["publisher"]["name"] == "TU Graz"
    assert root["keywords"] == "friction"
    assert "tables/wear/carriage.parquet" in {item.id for item in root["hasPart"]}
    assert main(said) == 7
    assert "exists already" in capsys.readouterr().err
    assert main([*said, "--overwrite", "--author", "Bea Klein"]) == 0
    author = ROCrate(target).root_dataset["author"]
    assert author["name"] == "Bea Klein"


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ([], "data without a licence"),
        (["--license", "CC-BY"], "'CC-BY' is no licence that is known here"),
        (["--license", "CC0-1.0", "--author", "Ada 0000-0002-1825-0098"], "wrong check digit"),
        (["--license", "CC0-1.0", "--doi", "zenodo.12"], "is no DOI"),
        (["--license", "CC0-1.0", "--stream", "carriage"], "--stream is not for --to rocrate"),
    ],
)
def test_incomplete_publication_is_refused(
    tmp_path: Path,
    record: Record,
    capsys: pytest.CaptureFixture[str],
    said: list[str],
    message: str,
) -> None:
    assert main(["export", str(record()), "--to", "rocrate", *said]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "wear.crate.zip").exists()


def test_recording_without_operator_needs_an_author(
    record: Record, capsys: pytest.CaptureFixture[str]
) -> None:
    path = record(operator="")
    assert main(["export", str(path), "--to", "rocrate", "--license", "CC0-1.0"]) == 2
    assert "give --author" in capsys.readouterr().err


def test_mistake_in_publication_of_lab_is_located(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lab = tmp_path / "lab.yaml"
    lab.write_text(
        "lab: tribology\nfields: {}\npublication:\n  license: free\n"
        "  authors:\n    - {name: Ada Lovelace, orcid: 0000-0002-1825-0098}\n"
    )
    assert main(["check", str(lab)]) == 2
    shown = "".join(capsys.readouterr())
    assert f"{lab}:4:" in shown
    assert f"{lab}:6:" in shown
