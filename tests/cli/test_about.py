"""What a person states on a run stands in its recording, its lists and its report."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from rigd.cli.main import main
from rigd.record import Recording
from rigd.sdk.shipped_files import shipped_folder

SAID = [
    "--operator", "A. Miller", "--note", "wheel cleaned", "--specimen", "W7", "--meta", "batch=13",
]  # fmt: skip


def run(path: Path, *said: str) -> int:
    """Play the quick procedure in virtual time."""
    return main(["run", "quick", "--rig", "lugre-1", "--quiet", "--output", str(path), *said])


def test_note_and_metadata_are_recorded_and_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said, silent = tmp_path / "said.mcap", tmp_path / "silent.mcap"
    assert run(said, *SAID) == 0
    assert run(silent) == 0
    capsys.readouterr()

    assert main(["info", str(said)]) == 0
    shown = capsys.readouterr().out
    for text in ("A. Miller", "wheel cleaned", "specimen    W7", "batch=13"):
        assert text in shown
    main(["info", str(said), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert (found["operator"], found["note"]) == ("A. Miller", "wheel cleaned")
    assert (found["specimen"], found["meta"]) == ({"name": "W7"}, {"batch": "13"})

    main(["runs", str(tmp_path), "--meta", "batch=13", "--json"])
    assert [Path(load["recording"]).name for load in json.loads(capsys.readouterr().out)] == [
        "said.mcap"
    ]

    assert main(["report", str(said)]) == 0
    page = (tmp_path / "said-run.html").read_text(encoding="utf-8")
    for text in (
        "A. Miller",
        "wheel cleaned",
        "Specimen",
        "W7",
        "batch",
        "SIMULATED, virtual time",
    ):
        assert text in page.split("<main>")[0]


def test_resume_finds_rig_beside_a_changed_copy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rig = (shipped_folder("configs") / "sim_lugre.yaml").read_bytes()
    (tmp_path / "a.yaml").write_bytes(rig + b"# changed\n")
    (tmp_path / "b.yaml").write_bytes(rig)
    path = tmp_path / "run.mcap"
    assert main(["run", "quick", "--rig", "b.yaml", "--quiet", "--output", str(path)]) == 0
    assert main(["run", "--resume", str(path)]) == 0


def test_same_words_and_seed_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("one", "two"):
        assert run(tmp_path / f"{name}.mcap", *SAID) == 0
    assert (tmp_path / "one.mcap").read_bytes() == (tmp_path / "two.mcap").read_bytes()


def test_control_characters_in_a_note_start_no_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mcap"
    assert run(path, "--note", "a\x1b[2Jb") == 2
    assert "U+001B" in capsys.readouterr().err
    assert not path.exists()


def test_a_specimen_without_a_name_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mcap"
    for wrong in ("../W7", "W 7", "-7", "x" * 61):
        assert run(path, f"--specimen={wrong}") == 2
        assert "is not the name of a specimen" in capsys.readouterr().err
    assert not path.exists()


def test_a_run_goes_on_with_its_specimen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mcap"
    assert run(path, "--specimen", "W7") == 0
    assert main(["run", "--resume", str(path), "--specimen", "W8"]) == 2
    assert "was begun with specimen W7, not with W8" in capsys.readouterr().err


def test_a_name_with_two_values_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mcap"
    assert run(path, "--meta", "specimen=W7", "--meta", "specimen=W8") == 2
    assert "--meta gives specimen two values" in capsys.readouterr().err
    assert not path.exists()


def test_a_described_specimen_is_recorded_and_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("specimens").mkdir()
    text = "specimen: W7\ncoating: PTFE\nsize: {diameter: 20 mm}\n"
    Path("specimens/W7.yaml").write_text(text)
    path = tmp_path / "run.mcap"
    assert run(path, "--specimen", "W7") == 0
    capsys.readouterr()
    main(["info", str(path)])
    assert "specimen    W7: coating PTFE, size.diameter 20 mm" in capsys.readouterr().out
    assert Recording.open(path).attachments["specimen.yaml"].data == text.encode()
    main(["runs", ".", "--where", "specimen.coating == PTFE and size.diameter > 1 cm"])
    assert "run.mcap" in capsys.readouterr().out


def test_check_names_entries_kept_as_text(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "W7.yaml"
    path.write_text("specimen: W7\ncoating: PTFE\nhardness: 62 HRC\nmass: 12 g\nmade: 2026-08-14\n")
    assert main(["check", str(path)]) == 0
    assert capsys.readouterr().out.endswith(
        "4 entries: right; kept as text, since it is no number with a unit: hardness ('62 HRC')\n"
    )


def test_a_run_without_demanded_fields_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = shipped_folder("configs") / "sim_lugre.yaml"
    (tmp_path / "lab.yaml").write_text("lab: mine\nfields: {meta.batch: {required: true}}\n")
    folder = tmp_path / "rigs"
    shutil.copytree(rig.parent, folder)
    (folder / rig.name).write_text(f"{rig.read_text()}\nlab: ../lab.yaml\n")
    path, command = tmp_path / "run.mcap", ["run", "quick", "--rig", str(folder / rig.name)]
    assert main([*command, "--quiet", "--output", str(path)]) == 2
    assert "the lab mine demands meta.batch of each run" in capsys.readouterr().err
    assert not path.exists()


def test_a_later_note_is_shown_and_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mcap"
    assert run(path, "--note", "as before") == 0
    assert main(["note", str(path), "wheel was worn", "--author", "B. Baker"]) == 0
    capsys.readouterr()
    assert main(["info", str(path)]) == 0
    assert "added note  wheel was worn (B. Baker, 20" in capsys.readouterr().out
    main(["runs", str(tmp_path), "--where", "note contains worn and note contains before"])
    assert "as before / wheel was worn" in capsys.readouterr().out
    main(["runs", str(tmp_path), "--where", 'note.author == "B. Baker"', "--json"])
    (found,) = json.loads(capsys.readouterr().out)
    assert (found["note"], found["notes"][0]["text"]) == ("as before", "wheel was worn")
    assert main(["note", str(path), " "]) == 2
    assert "the note is empty" in capsys.readouterr().err


def test_runs_since_a_date_are_listed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ["20200301-080000-old.mcap", "20261121-080000-new.mcap"]
    for name in names:
        assert run(tmp_path / name) == 0
    listed = {}
    for since in ("2020-02-01", "2026-11-01", "2026-11-21T08:00:01+00:00", "9d"):
        capsys.readouterr()
        assert main(["runs", str(tmp_path), "--since", since, "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        listed[since] = [Path(item["recording"]).name for item in found]
    assert listed["2020-02-01"] == names
    assert listed["2026-11-01"] == names[1:]
    assert listed["2026-11-21T08:00:01+00:00"] == []
    assert names[0] not in listed["9d"]


def test_runs_show_when_they_were_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path / "20261121-080000-a.mcap") == 0
    capsys.readouterr()
    main(["runs", str(tmp_path)])
    assert "2026-11-21 08:00" in capsys.readouterr().out
