"""What a text file means: separators, decimal signs, lines before the data, encodings, times."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from support.recordings.imported import MAP, Import

from rigd.analysis.heading import heading
from rigd.model import ConfigError
from rigd.record import verify

TABLE = "t,F,v\n" + "".join(f"{i / 1000},{i * 0.5},{i}\n" for i in range(40))
START_NS = 1_457_085_600_000_000_000


def test_values_become_si_at_their_times(bring_in: Import) -> None:
    rows = bring_in(TABLE).read("samples")
    assert rows["t_ns"].tolist() == [START_NS + i * 1_000_000 for i in range(40)]
    assert rows["force"].tolist() == [i * 0.5 for i in range(40)]
    assert rows["speed"].tolist() == [i * 0.001 for i in range(40)]


def test_recording_states_its_origin(bring_in: Import, tmp_path: Path) -> None:
    recording = bring_in(TABLE)
    info = recording.info
    assert (info.mode, info.state, info.procedure, info.rig) == (
        *("imported", "complete", "bench", "old_bench"),
    )
    (file,) = json.loads(recording.metadata["import"]["files"])
    data = (tmp_path / "old.csv").read_bytes()
    assert (file["file"], file["bytes"], file["sha256"]) == (
        *("old.csv", len(data), hashlib.sha256(data).hexdigest()),
    )
    assert recording.attachments["import_map.yaml"].data.decode() == MAP
    assert verify(recording.path).sound
    assert [trial.complete for trial in recording.trials] == [True]
    entries = dict(heading([info]).entries)
    assert entries["Imported from"].startswith(f"old.csv, {len(data)} bytes, sha256 ")


@pytest.mark.parametrize(
    ("text", "options"),
    [
        (TABLE.replace("\n", "\r\n"), "{}"),
        (TABLE + "\n\r\n", "{}"),
        (b"\xef\xbb\xbf" + TABLE.encode(), "{}"),
        (TABLE.replace(",", "\t"), "{}"),
        (TABLE.replace(",", "  "), "{separator: space}"),
        (TABLE.replace(",", ";").replace(".", ","), "{decimal: ','}"),
        (TABLE.encode("utf-16"), "{encoding: utf-16}"),
        (TABLE.replace("F", "Kraft µ [N]", 1).replace("F", "", 1).encode("latin-1"),
         "{encoding: latin-1}"),
        ("Logger 7\n\n" + TABLE.replace("v\n", "v\n[s],[N],[mm/s]\n", 1), "{header: 3, units: 4}"),
        ('"t","F","v"\n' + TABLE.partition("\n")[2], "{}"),
        (TABLE.replace(",", ",+").replace("t,+F,+v", "t,F,v"), "{}"),
        (TABLE[:-1], "{open_end: true}"),
    ],
    ids=["crlf", "blank end", "bom", "tabs", "spaces", "comma", "utf-16", "latin-1", "units line",
         "quoted", "plus", "open end"],
)  # fmt: skip
def test_each_way_of_writing_gives_same_rows(
    bring_in: Import, text: str | bytes, options: str
) -> None:
    map = MAP.replace("column: F", "column: Kraft µ") if options == "{encoding: latin-1}" else MAP
    rows = bring_in(text, options, map=map).read("samples")
    assert rows["t_ns"][-1] == START_NS + 39_000_000
    assert rows["force"].tolist() == [i * 0.5 for i in range(40)]


def test_block_by_block_gives_the_same_rows(
    bring_in: Import, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rigd.importing.tables.csv_table.BLOCK_BYTES", 100)
    rows = bring_in(TABLE).read("samples")
    assert rows["force"].tolist() == [i * 0.5 for i in range(40)]


def test_file_without_names_goes_by_numbers(bring_in: Import) -> None:
    map = MAP.replace("column: t", "column: 1").replace("column: F", "column: 2")
    text = TABLE.partition("\n")[2]
    rows = bring_in(text, "{header: 0}", map=map.replace("column: v", "column: 3"))
    assert rows.count("samples") == 40


def test_scaled_reading_is_recorded_beside(bring_in: Import) -> None:
    wired = "force: {column: F, unit: mV, zero: 1 V, scale: 250 N/V}"
    recording = bring_in(TABLE, map=MAP.replace("force: {column: F, unit: N}", wired))
    channels = {item.name: item for item in recording.streams["samples"].channels}
    assert (channels["force"].unit, channels["force_raw"].unit) == ("N", "V")
    assert channels["force_raw"].raw_of == "force"
    rows = recording.read("samples")
    assert np.allclose(rows["force"], (np.arange(40) * 0.5e-3 - 1.0) * 250.0, rtol=1e-15)


def test_named_missing_values_become_nan(bring_in: Import) -> None:
    text = TABLE.replace("0.5,1\n", "-9999,1\n")
    rows = bring_in(text, "{missing: '-9999'}").read("samples")
    missing = np.isnan(rows["force"])
    assert np.flatnonzero(missing).tolist() == [1]


@pytest.mark.parametrize(
    ("time", "cell", "expected"),
    [
        ("{column: t, unit: ns, since: 1970-01-01}", "1457085600000000123", START_NS + 123),
        ("{column: t, unit: ms, since: 1970-01-01}", "1457085600000.25", START_NS + 250_000),
        ("{column: t, unit: s, since: 1904-01-01}", "3539930400.5", START_NS + 500_000_000),
        ("{column: t, format: iso}", "2016-03-04T12:00:00.25+02:00", START_NS + 250_000_000),
        ("{column: t, format: '%d.%m.%Y %H:%M:%S'}", "04.03.2016 10:00:01", START_NS + 10**9),
        ("{column: t, unit: s, shift: -2 ms}", "1", START_NS + 998_000_000),
        ("{rate: 8 kHz}", "unused", START_NS),
    ],
)
def test_first_sample_has_its_time(bring_in: Import, time: str, cell: str, expected: int) -> None:
    map = MAP.replace("time: {column: t, unit: s}", f"time: {time}")
    rows = bring_in(f"t,F,v\n{cell},1,2\n", map=map).read("samples")
    assert rows["t_ns"].tolist() == [expected]


def test_columns_of_two_rates_become_two_streams(bring_in: Import) -> None:
    map = """\
map: bench
rig: old_bench
sources:
  force:
    file: "{test}.csv"
    time: {column: t, unit: s}
    channels: {force: {column: F, unit: N}}
    sparse: true
  speed:
    file: "{test}.csv"
    time: {column: t, unit: s}
    channels: {speed: {column: v, unit: m/s}}
    sparse: true
"""
    text = "t,F,v\n" + "".join(f"{i / 1000},{i},{'' if i % 4 else i}\n" for i in range(40))
    recording = bring_in(text, map=map)
    assert (recording.count("force"), recording.count("speed")) == (40, 10)
    assert recording.read("speed")["speed"].tolist() == list(range(0, 40, 4))


@pytest.mark.parametrize("end", ["\r", "\n", "\r\n"])
@pytest.mark.parametrize("block_bytes", [64, 1 << 20])
def test_each_line_end_gives_the_same(
    bring_in: Import, monkeypatch: pytest.MonkeyPatch, end: str, block_bytes: int
) -> None:
    monkeypatch.setattr("rigd.importing.tables.csv_table.BLOCK_BYTES", block_bytes)
    rows = bring_in(TABLE.replace("\n", end)).read("samples")
    assert rows["force"].tolist() == [i * 0.5 for i in range(40)]
    with pytest.raises(ConfigError, match="'x' is no number") as raised:
        bring_in((TABLE + "9,x,9\n").replace("\n", end), name="wrong.csv")
    assert str(raised.value.place).endswith("wrong.csv:42:3")


def test_lines_of_mixed_ends_keep_their_numbers(bring_in: Import) -> None:
    head, _, rest = TABLE.partition("\n")
    text = f"{head}\r{rest}9,x,9\n"
    with pytest.raises(ConfigError, match="'x' is no number") as raised:
        bring_in(text)
    assert str(raised.value.place).endswith("old.csv:42:3")


LABVIEW = "t\tF\tv\tComment\n" + "".join(f"{i / 1000}\t{i * 0.5}\t{i}\n" for i in range(40))


def test_names_without_cells_are_passed_over(bring_in: Import) -> None:
    """LabVIEW ends its names with `Comment`."""
    rows = bring_in(LABVIEW).read("samples")
    assert rows["force"].tolist() == [i * 0.5 for i in range(40)]
    with pytest.raises(ConfigError, match="'Comment' has a name and no cells"):
        bring_in(LABVIEW, map=MAP.replace("column: F", "column: Comment"), name="a.csv")
    with pytest.raises(ConfigError, match="2 cells, expected 3"):
        bring_in(LABVIEW + "1\t2\n", name="b.csv")


@pytest.mark.parametrize("rows", [(0,), (0, 20), (7,)])
@pytest.mark.parametrize("said", ["run 3", ""])
def test_comments_of_labview_rows_are_passed_over(
    bring_in: Import, rows: tuple[int, ...], said: str
) -> None:
    lines = LABVIEW.splitlines()
    for row in rows:
        lines[row + 1] += f"\t{said}"
    found = bring_in("\n".join(lines) + "\n").read("samples")
    assert found["force"].tolist() == [i * 0.5 for i in range(40)]


def test_row_that_lacks_cell_beside_comment_is_named(bring_in: Import) -> None:
    cut = LABVIEW.replace("0.02\t10.0\t20\n", "0.02\t10.0\n")
    with pytest.raises(ConfigError, match="the line has 2 cells, expected 3 columns") as raised:
        bring_in(cut.replace("0.0\t0\n", "0.0\t0\tbegins\n", 1))
    assert str(raised.value.place).endswith("old.csv:22:10")


@pytest.mark.parametrize("block_bytes", [64, 1 << 20])
def test_last_line_parts_tables_of_a_file(
    bring_in: Import, monkeypatch: pytest.MonkeyPatch, block_bytes: int
) -> None:
    monkeypatch.setattr("rigd.importing.tables.csv_table.BLOCK_BYTES", block_bytes)
    text = f"{TABLE}\nsecond stroke\n{TABLE.replace('.5', '.75')}"
    with pytest.raises(ConfigError, match="the line is empty, and others follow") as raised:
        bring_in(text)
    assert "`last: 41` below `text:`" in str(raised.value.hint)
    first = bring_in(text, "{last: 41}", name="first.csv").read("samples")
    second = bring_in(text, "{header: 44}", name="second.csv").read("samples")
    assert first["force"].tolist() == [i * 0.5 for i in range(40)]
    assert second["force"][1] == 0.75
    assert len(second) == 40


@pytest.mark.parametrize(
    ("cell", "named"),
    [("\u22121.5", "U+2212 MINUS SIGN"), ("1\u00a0000", "U+00A0 NO-BREAK SPACE")],
)
def test_character_that_looks_alike_is_named(bring_in: Import, cell: str, named: str) -> None:
    with pytest.raises(ConfigError) as raised:
        bring_in(TABLE + f"9,{cell},9\n")
    assert named in raised.value.message
