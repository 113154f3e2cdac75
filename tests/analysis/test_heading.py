"""The first lines of every report: simulated or not, rig, date, operator."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from rigd.analysis.heading import heading
from rigd.record import Recording, RecordingWriter, RunInfo
from rigd.record.read.moment import recorded_at

MADE = datetime(2026, 11, 22, 12, 30, tzinfo=UTC)
FILE_DATE = datetime(2026, 10, 5, 8, 0, tzinfo=UTC)
VIRTUAL = {"mode": "simulated, virtual time", "started": "2020-01-02T00:00:00+00:00"}
REAL = {"mode": "hardware", "started": "2026-03-04T05:06:07+00:00"}


def info_of(path: Path, run: Mapping[str, str], **metadata: Mapping[str, str]) -> RunInfo:
    """Return the summary of a recording that holds nothing but its metadata."""
    RecordingWriter.create(
        path, streams=[], metadata={"run": run, **metadata}, attachments=(), start_ns=1,
        sync_interval_s=None,
    ).close()  # fmt: skip
    os.utime(path, (FILE_DATE.timestamp(),) * 2)
    return Recording.open(path).info


def test_simulated_data_carry_a_badge(tmp_path: Path) -> None:
    virtual = info_of(tmp_path / "a.mcap", VIRTUAL)
    wire = info_of(tmp_path / "b.mcap", {**REAL, "mode": "simulated at the wire"})
    real = info_of(tmp_path / "c.mcap", REAL)
    assert heading([virtual], MADE).badge == "SIMULATED, virtual time"
    assert heading([wire], MADE).badge == "SIMULATED at the wire"
    assert heading([real], MADE).badge == ""
    assert heading([real, wire], MADE).badge == "1 of 2 recordings SIMULATED"


def test_run_on_devices_gives_its_own_date(tmp_path: Path) -> None:
    info = info_of(tmp_path / "20991231-000000-x.mcap", REAL)
    assert recorded_at(info).of == "run"
    entries = dict(heading([info], MADE).entries)
    assert entries["Recorded"] == "2026-03-04 05:06 UTC"
    assert entries["Report made"] == "2026-11-22 12:30 UTC"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("20261121-080910-quick.mcap", "2026-11-21 08:09 UTC (by its file name)"),
        ("quick.mcap", "2026-10-05 08:00 UTC (date of the file)"),
        ("20261399-080910-quick.mcap", "2026-10-05 08:00 UTC (date of the file)"),
    ],
)
def test_virtual_time_is_never_date_of_run(tmp_path: Path, name: str, said: str) -> None:
    entries = dict(heading([info_of(tmp_path / name, VIRTUAL)], MADE).entries)
    assert entries["Recorded"] == f"{said}; virtual time from 2020-01-02"


def test_several_dates_share_one_remark(tmp_path: Path) -> None:
    infos = [info_of(tmp_path / name, VIRTUAL) for name in ("a.mcap", "b.mcap", "c.mcap")]
    os.utime(tmp_path / "b.mcap", (FILE_DATE.timestamp() + 60,) * 2)
    assert dict(heading(infos, MADE).entries)["Recorded"] == (
        "2026-10-05 08:00 UTC, 2026-10-05 08:01 UTC (dates of the files); "
        "virtual time from 2020-01-02"
    )


def test_virtual_times_of_many_recordings_stay_short(tmp_path: Path) -> None:
    """Each seed of a simulation has a virtual time of its own."""
    infos = [
        info_of(
            tmp_path / f"{day}.mcap", {**VIRTUAL, "started": f"2020-01-{day:02}T00:00:00+00:00"}
        )
        for day in range(1, 12)
    ]
    two, many = (dict(heading(some, MADE).entries)["Recorded"] for some in (infos[:2], infos))
    assert two.endswith("; virtual time from 2020-01-01, 2020-01-02")
    assert many.endswith("; virtual time from 2020-01-01 … 2020-01-11")


def test_note_and_operator_are_under_the_title(tmp_path: Path) -> None:
    first = {**REAL, "rig": "bench", "procedure": "quick", "operator": "A. Miller", "note": "dry"}
    item = info_of(tmp_path / "a.mcap", first, meta={"specimen": "W7"})
    two = info_of(
        tmp_path / "b.mcap", {**first, "note": ""}, meta={"specimen": "W8"},
        resumed={"operator": "B. Baker"},
    )  # fmt: skip
    found = heading([item, two], MADE)
    entries = dict(found.entries)
    assert entries["Rig"] == "bench"
    assert entries["Recordings"] == "a.mcap, b.mcap"
    assert entries["Operator"] == "A. Miller; A. Miller, resumed by B. Baker"
    assert entries["specimen"] == "W7; W8"
    assert found.notes == ("a.mcap: dry",)
    later = {"2026-11-27T08:00:00Z": '{"author": "B", "text": "worn"}'}
    noted = replace(item, metadata={**item.metadata, "notes": later})
    assert heading([noted], MADE).notes == ("dry", "worn (B, 2026-11-27 08:00)")


def test_names_that_a_heading_has_are_marked(tmp_path: Path) -> None:
    meta = {"Rig": "mine", "operator": "B", "specimen": "W7"}
    info = info_of(tmp_path / "a.mcap", {**REAL, "rig": "lugre-1", "operator": "A"}, meta=meta)
    entries = heading([info], MADE).entries
    names = [name.casefold() for name, _ in entries]
    assert len(set(names)) == len(names)
    assert dict(entries)["Rig"] == "lugre-1"
    assert dict(entries)["Rig (--meta)"] == "mine"
    assert dict(entries)["operator (--meta)"] == "B"
    assert dict(entries)["specimen"] == "W7"
    stated = replace(info, metadata={**info.metadata, "specimen": {"name": "W8", "coating": "DLC"}})
    entries = heading([stated], MADE).entries
    assert dict(entries)["Specimen"] == "W8"
    assert dict(entries)["Specimen's coating"] == "DLC"
    assert dict(entries)["specimen (--meta)"] == "W7"
