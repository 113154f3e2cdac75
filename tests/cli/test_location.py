"""A command prints which files it took, if names could mean several."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.commands.asking import ASKING

from rigd.cli.main import main
from rigd.record import Recording
from rigd.sdk.shipped_files import shipped_folder

#: What is printed if a forgotten copy of the shipped rig is in the folder.
TITLE = (
    "quick (./rep.yaml, instead of the shipped procedure) on lugre-1 "
    "(./coated_rig.yaml, instead of the shipped rig)"
)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    configs = shipped_folder("configs")
    rig = (configs / "sim_lugre.yaml").read_text("utf-8")
    (tmp_path / "coated_rig.yaml").write_text(rig.replace("plants/", f"{configs}/plants/"), "utf-8")
    (tmp_path / "rep.yaml").write_text(ASKING.replace("asking", "quick"), "utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def told(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[str, str]:
    """Return what a command prints to both streams, in words that a line break may part."""
    assert main(list(words)) == 0
    shown = capsys.readouterr()
    return " ".join(shown.out.split()), " ".join(shown.err.split())


def test_run_names_its_files_first_and_records_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "quick", "--rig", "lugre-1", "--output", "run.mcap"]) == 0
    first = capsys.readouterr().err.splitlines()[0]  # whole: this is no terminal
    assert first == f"{TITLE}, 2 trials, recording to run.mcap"
    run = Recording.open(folder / "run.mcap").metadata["run"]
    assert (
        f"{run['procedure']} ({run['procedure_file']}) on {run['rig']} ({run['rig_file']})" == TITLE
    )


def test_a_dry_run_names_its_files_first(capsys: pytest.CaptureFixture[str]) -> None:
    out, _ = told(capsys, "run", "quick", "--rig", "lugre-1", "--dry-run")
    assert out.startswith(f"dry run: {TITLE} ")
    out, _ = told(capsys, "run", "rep.yaml", "--rig", "configs/sim_lugre.yaml", "--dry-run")
    assert out.startswith("dry run: quick (rep.yaml) on lugre-1 (shipped) ")


def test_check_names_files_that_name_means(capsys: pytest.CaptureFixture[str]) -> None:
    out, _ = told(capsys, "check", "quick", "--rig", "lugre-1")
    assert out.startswith("rig lugre-1 (./coated_rig.yaml, instead of the shipped rig) quick: ")
    assert "procedure quick (./rep.yaml, instead of the shipped procedure), 2 trials" in out


@pytest.mark.parametrize(
    "words", [["read", "--once", "--rig"], ["tare", "wheel", "--rig"], ["sim"]]
)
def test_commands_on_devices_name_their_rig_file(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """A person reads it on stderr, also before an error; values alone stand on stdout."""
    main([*words, "lugre-1"])
    shown = capsys.readouterr()
    first = shown.err.splitlines()[0]
    assert first == "rig lugre-1 (./coated_rig.yaml, instead of the shipped rig)"
    assert "coated_rig" not in shown.out


def test_the_doctor_names_the_file_of_the_rig(capsys: pytest.CaptureFixture[str]) -> None:
    out, _ = told(capsys, "doctor", "--rig", "lugre-1", "--seconds", "0.5")
    assert out.startswith("rig lugre-1 (./coated_rig.yaml, instead of the shipped rig) This takes")
