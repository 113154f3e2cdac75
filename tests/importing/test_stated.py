"""What a person states of imported tests stands in their recordings, as in those of runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.recordings.imported import MAP

from rigd.catalogue import parse_where, search
from rigd.cli.main import main
from rigd.record import Recording, verify

SAID = ["--operator", "B. Klein", "--note", "from the old logger", "--meta", "batch=3"]


@pytest.fixture
def command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Imports two tests from the current folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    Path("map.yaml").write_text(MAP)
    for name in ("one.csv", "two.csv"):
        Path(name).write_text("t,F,v\n0,1,2\n0.1,2,3\n")
    return ["import", "one.csv", "two.csv", "--map", "map.yaml"]


def test_imported_tests_state_specimen_and_are_found(command: list[str]) -> None:
    Path("specimens").mkdir()
    Path("specimens/S7.yaml").write_text("specimen: S7\ncoating: PTFE\n")
    assert main([*command, *SAID, "--specimen", "S7"]) == 0
    for name in ("one", "two"):
        recording = Recording.open(f"runs/{name}.mcap")
        run = recording.info.metadata["run"]
        assert (run["operator"], run["note"]) == ("B. Klein", "from the old logger")
        assert recording.metadata["specimen"] == {"name": "S7", "coating": "PTFE"}
        assert recording.metadata["meta"] == {"batch": "3"}
        assert recording.attachments["specimen.yaml"].data == b"specimen: S7\ncoating: PTFE\n"
        assert verify(recording.path).sound
    where = 'specimen.coating == PTFE and meta.batch == 3 and operator contains "klein"'
    assert len(search(Path("runs"), parse_where(where)).lines) == 2


def test_import_without_statements_records_none(command: list[str]) -> None:
    assert main(command) == 0
    metadata = Recording.open("runs/one.mcap").metadata
    assert not {"meta", "specimen"} & set(metadata)
    assert not {"operator", "note"} & set(metadata["run"])


@pytest.mark.parametrize(
    ("said", "message"),
    [
        (["--specimen", "S 7"], "is not the name of a specimen"),
        (["--meta", "batch"], "'batch' is not NAME=VALUE"),
        (["--operator", "A\x1b[31m"], "control character U+001B"),
        (["--specimen", "broken"], "specimens/broken.yaml"),
    ],
)
def test_wrong_statement_imports_nothing(
    command: list[str], capsys: pytest.CaptureFixture[str], said: list[str], message: str
) -> None:
    Path("specimens").mkdir()
    Path("specimens/broken.yaml").write_text("coating: PTFE\n")
    assert main([*command, *said]) == 2
    assert message in capsys.readouterr().err
    assert not Path("runs").exists()


def test_info_shows_what_was_done_to_times(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    Path("map.yaml").write_text(MAP.replace("unit: s}", "unit: s, coarse: spread}"))
    Path("one.csv").write_text("t,F,v\n0,1,2\n0,1,2\n0.1,2,3\n0.1,2,3\n")
    assert main([*command[:2], *command[3:]]) == 0
    assert main(["info", "runs/one.mcap"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "4 rows at 2 different times, spread evenly between them" in shown
