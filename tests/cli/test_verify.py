"""Checking and repairing recordings from the command line: nothing that was recorded goes away."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rigd.cli.main import main
from rigd.model.channels import Channel, Stream
from rigd.model.rows import row_dtype
from rigd.record import Recording, RecordingWriter

AXIS = Stream("axis", tuple(Channel(f"c{i}", "m") for i in range(60)))
SECOND = 1_000_000_000


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two trials of two seconds; a second of ``axis`` is one chunk."""
    monkeypatch.chdir(tmp_path)
    rows = np.zeros(500, row_dtype(AXIS))
    rows["t_ns"] = np.arange(500) * (SECOND // 100)
    rows["c0"] = np.random.default_rng(1).normal(size=500)
    with RecordingWriter.create(
        tmp_path / "run.mcap",
        streams=[AXIS],
        metadata={"run": {"procedure": "sweep", "rig": "bench"}},
        attachments=(),
        start_ns=0,
        compression="none",
    ) as writer:
        writer.event(0, "run_start")
        for number in (1, 2):
            start = (2 * number - 2) * SECOND
            data = {"parameters": {"speed": 0.1 * number}, "units": {"speed": "mm/s"}}
            writer.event(start, "trial_start", number, data)
            writer.event(start + 2 * SECOND, "trial_end", number, {"complete": True})
        writer.event(5 * SECOND, "run_end", None, {"state": "complete", "reason": "all played"})
        writer.write("axis", rows)
    return tmp_path / "run.mcap"


def spoil(path: Path, chunk: int) -> bytes:
    content = bytearray(path.read_bytes())
    at = [
        item.chunk_start_offset
        for item in Recording.open(path).contents.chunks
        if 2 in item.message_index_offsets
    ]
    content[at[chunk] + 200] ^= 1
    path.write_bytes(content)
    return bytes(content)


def test_a_sound_file_is_verified(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = path.read_bytes()
    assert main(["verify", "run.mcap"]) == 0
    assert capsys.readouterr().out.startswith("run.mcap: whole, written by rigd, ")
    assert path.read_bytes() == before
    assert [item.name for item in path.parent.iterdir()] == ["run.mcap"]


def test_several_files_are_shown(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = path.read_bytes()
    (path.parent / "second.mcap").write_bytes(content)
    assert main(["info", "run.mcap", "second.mcap"]) == 0
    said = capsys.readouterr().out
    assert said.index("run.mcap") < said.index("second.mcap")
    assert main(["info", "run.mcap", "missing.mcap", "second.mcap", "--json"]) == 7
    captured = capsys.readouterr()
    found = json.loads(captured.out)
    assert [item["recording"] for item in found] == ["run.mcap", "second.mcap"]
    assert "missing.mcap" in captured.err
    assert main(["info", "run.mcap", "second.mcap", "--attachments", "files"]) == 2
    assert not Path("files").exists()


def test_verify_predicts_the_result_of_recover(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a file that lacks its end, as of one that is damaged: what is announced, happens."""
    cut = path.read_bytes()[: Recording.open(path).data_end - 13]
    for content, originals in ((cut, []), (spoil(path, 2), ["run.mcap.orig"])):
        path.write_bytes(content)
        assert main(["verify", "run.mcap"]) == 7
        said = capsys.readouterr().out
        assert "keeps the damaged file as run.mcap.orig" in said
        assert "a file that only lacks its end is completed in place" in said
        assert main(["recover", "run.mcap"]) == 0
        assert [item.name for item in path.parent.glob("*.orig")] == originals


def test_damage_is_placed_and_nothing_changed(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged = spoil(path, 2)
    assert main(["verify", "run.mcap"]) == 7
    said = capsys.readouterr().out
    assert "lost: 100 rows of axis, 2.000 s to 2.990 s" in said
    assert "trial 2 is not complete: lost: 100 rows of axis" in said
    assert "trial 1" not in said
    assert path.read_bytes() == damaged
    assert main(["verify", "run.mcap", "--json"]) == 7
    (found,) = json.loads(capsys.readouterr().out)
    assert (found["sound"], found["rows"]["/axis"]) == (False, 400)
    (lost,) = found["lost_rows"]
    assert (lost["stream"], lost["rows"]) == ("axis", 100)
    assert found["trials"] == [{"number": 2, "lost": "lost: 100 rows of axis"}]
    assert len(found["damages"]) == 1


def test_info_claims_nothing_about_an_unchecked_file(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(path, 2)
    assert main(["info", "run.mcap"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "file        written by rigd, not checked (`rigd verify run.mcap` does)" in lines
    of_the_run = "run         complete: all played"  # and not of its rows
    assert [line for line in lines if "complete" in line] == [of_the_run]


def test_info_lists_the_trials(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", "run.mcap"]) == 0
    lines = capsys.readouterr().out.splitlines()
    first = next(line.split() for line in lines if line.strip().startswith("1 "))
    assert first == ["1", "2.00", "100", "mm/s", "played"]


def test_a_notebook_counts_one_trial(tmp_path: Path) -> None:
    with RecordingWriter.create(
        tmp_path / "run.mcap", streams=[AXIS], metadata={}, attachments=(), start_ns=0
    ) as writer:
        writer.event(0, "trial_start", 1, {})
        writer.event(SECOND, "trial_end", 1, {"complete": True})
    assert repr(Recording.open(tmp_path / "run.mcap").trials).splitlines()[0] == "1 trial"


def test_a_repair_keeps_the_damaged_file(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    damaged = spoil(path, 2)
    assert main(["recover", "run.mcap"]) == 0
    said = capsys.readouterr().out
    assert "the damaged file is kept as run.mcap.orig" in said
    assert "trial 2 is not complete" in said
    assert Path("run.mcap.orig").read_bytes() == damaged
    assert main(["info", "run.mcap"]) == 0
    said = capsys.readouterr().out
    assert "2 begun, 1 not complete" in said
    assert "run.mcap lacks 100 rows of axis" in said
    assert main(["verify", "run.mcap"]) == 0
    assert main(["recover", "run.mcap"]) == 0
    assert "run.mcap: intact" in capsys.readouterr().out


def test_page_and_tables_name_what_is_lost(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spoil(path, 2)
    assert main(["report", "run.mcap"]) == 0
    said = capsys.readouterr().err
    assert "warning: run.mcap is damaged; the damaged parts were skipped" in said
    assert "warning: run.mcap lacks 100 rows of axis, 2.000 s to 2.990 s" in said
    assert main(["recover", "run.mcap"]) == 0
    capsys.readouterr()
    assert main(["export", "run.mcap", "--to", "csv"]) == 0
    assert "warning: run.mcap lacks 100 rows of axis" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["verify", "info", "identify"])
def test_hints_quote_a_path_with_spaces(
    path: Path, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    spoil(path, 2)
    path.write_bytes(path.read_bytes()[:-40])
    path.rename("my run.mcap")
    main([verb, "my run.mcap"])
    said = capsys.readouterr()
    assert "`rigd recover 'my run.mcap'`" in said.out + said.err


@pytest.mark.parametrize("verb", ["info", "verify", "report"])
def test_a_folder_instead_of_a_file_names_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    (folder := tmp_path / "my runs").mkdir()
    assert main([verb, str(folder)]) == 7
    assert f"`rigd runs '{folder}'` lists its recordings" in capsys.readouterr().err


def test_a_page_is_drawn_beside_a_missing_file(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", "none.mcap", "run.mcap"]) == 7
    said = capsys.readouterr()
    assert "cannot read none.mcap" in said.err
    assert "report: run-run.html" in said.out
    assert path.with_name("run-run.html").is_file()


def test_no_hint_sends_a_csv_to_be_repaired(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("old.csv").write_text("time,value\n" + "0.1,2.5\n" * 2000)
    for command in (["identify"], ["info"], ["verify"], ["export", "--to", "csv"]):
        assert main([command[0], "old.csv", *command[1:]]) == 7
        said = capsys.readouterr().err
        assert "It is no MCAP recording" in said
        assert "recover" not in said
