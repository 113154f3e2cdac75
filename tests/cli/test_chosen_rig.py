"""Commands without `--rig`, and `last` in place of recordings."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
from support.commands import command

import rigd
import rigd.remote
from rigd.cli.main import main
from rigd.cli.options import expanded, the_newest
from rigd.model import ConfigError
from rigd.model.errors import RigdError
from rigd.procedure.chosen_rig import chosen_rig, try_rig
from rigd.procedure.loader import load_procedure
from rigd.sdk.shipped_files import shipped_folder

SHORT = """\
procedure: short
title: Short
try_on: lugre-1
doc: For tests.
trial:
  steps:
    - {step: rest, set: {wheel_servo.current: 0 A}, for: 0.1 s}
"""
CONFIGS = shipped_folder("configs")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("RIGD_RIG", raising=False)
    (tmp_path / "short.yaml").write_text(SHORT)
    return tmp_path


def test_run_without_rig_is_simulated_and_says_so(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "short.yaml"]) == 0
    assert "no --rig: simulated on lugre-1, nothing moves\n" in capsys.readouterr().err
    assert main(["info", "last"]) == 0
    assert "SIMULATED, virtual time" in capsys.readouterr().out
    assert main(["run", "short.yaml", "--dry-run"]) == 0
    told = capsys.readouterr()
    assert "no --rig: simulated on lugre-1, nothing moves\n" in told.err
    assert "fit to run" in told.out


def test_environment_goes_before_settings_before_procedure(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert chosen_rig(None, "short.yaml").rig == "lugre-1"
    (folder / "rigd.yaml").write_text("default_rig: angle-1\n")
    found = chosen_rig(None, "short.yaml")
    assert found.rig == "angle-1"
    assert found.why == "no --rig: simulated on angle-1, as rigd.yaml says, nothing moves"
    monkeypatch.setenv("RIGD_RIG", "wire-1")
    found = chosen_rig(None, "short.yaml")
    assert found.rig == "wire-1"
    assert found.why == "no --rig: wire-1, simulated at the wire, as RIGD_RIG says"
    assert chosen_rig("articulated-1", "short.yaml").why == ""


def test_hardware_of_the_settings_is_named_as_real(folder: Path) -> None:
    text = (CONFIGS / "wire_lugre.yaml").read_text()
    (simulation,) = re.findall(r"^simulation:.*\n(?:[ #].*\n)*", text, re.MULTILINE)
    real = text.replace(simulation, "")
    (folder / "bench.yaml").write_text(real)
    (folder / "rigd.yaml").write_text("default_rig: bench.yaml\n")
    assert chosen_rig(None).why == "no --rig: the real rig wire-1, as rigd.yaml says"


def test_procedure_cannot_choose_hardware(folder: Path) -> None:
    (folder / "short.yaml").write_text(SHORT.replace("lugre-1", "wire-1"))
    with pytest.raises(ConfigError, match=r"short\.yaml:3:9: .* has no `plant`"):
        chosen_rig(None, "short.yaml")


@pytest.mark.parametrize(
    "words", [["run", "bare.yaml"], ["jog", "x=1"], ["read"], ["serve"], ["tare", "scale"]]
)
def test_without_any_rig_nothing_begins(folder: Path, words: list[str]) -> None:
    (folder / "bare.yaml").write_text(SHORT.replace("try_on: lugre-1\n", ""))
    ended = command.rigd(*words, cwd=folder)
    assert ended.code == 2
    assert "no rig is given" in ended.err
    assert "set RIGD_RIG, or write `default_rig: RIG` into rigd.yaml" in ended.err


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("default_rig: absent\n", "rigd.yaml: rig 'absent' is neither"),
        ("default_rig: [a]\n", "rigd.yaml:1:14"),
        ("rig: lugre-1\n", "unknown key 'rig'"),
        ("a: &x [*x]\n", "rigd.yaml:1:4"),
    ],
)
def test_wrong_settings_are_named(folder: Path, text: str, told: str) -> None:
    (folder / "rigd.yaml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        chosen_rig(None, "short.yaml")
    assert told in str(caught.value)


def test_check_takes_the_rig_of_each_procedure(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", "quick", "circles", "short.yaml"]) == 0
    out = capsys.readouterr().out
    assert "quick (shipped), 1 trial on lugre-1: right" in out
    assert "on articulated-1: right" in out
    (folder / "rigd.yaml").write_text("default_rig: lugre-1\n")
    assert main(["check", "rigd.yaml", "short.yaml"]) == 0
    assert "as rigd.yaml says" in capsys.readouterr().err


@pytest.mark.parametrize("file", sorted(shipped_folder("procedures").glob("*.yaml")), ids=str)
def test_each_shipped_procedure_names_a_simulated_rig(file: Path) -> None:
    assert try_rig(file) is not None
    assert load_procedure(file).source.try_on is not None


def test_last_is_the_newest_recording(folder: Path) -> None:
    (folder / "runs").mkdir()
    for number in (1, 2, 3):
        path = folder / "runs" / f"{number}.mcap"
        path.touch()
        os.utime(path, ns=(0, (9 - number) * 10**9))
    assert expanded([Path("last")]) == [Path("runs/1.mcap")]
    assert expanded([Path("last:2"), Path("x")]) == [
        Path("runs/2.mcap"), Path("runs/1.mcap"), Path("x")
    ]  # fmt: skip
    assert the_newest(Path("last")) == Path("runs/1.mcap")
    with pytest.raises(ConfigError, match="3 recordings in runs"):
        expanded([Path("last:4")])
    with pytest.raises(ConfigError, match="one is needed"):
        the_newest(Path("last:2"))
    (folder / "last").touch()
    assert expanded([Path("last")]) == [Path("last")]


def test_last_stands_for_recordings_of_each_command(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "short.yaml", "--runs", "mine"]) == 0
    (path,) = (folder / "mine").glob("*.mcap")
    path.rename(folder / "mine" / "a.mcap")
    (folder / "mine").rename(folder / "runs")
    capsys.readouterr()
    for words in (["verify", "last"], ["note", "last", "seen"], ["export", "last", "--to", "csv"]):
        assert main(words) == 0, words
    assert main(["run", "--resume", "last"]) == 0
    assert "runs/a.mcap: all 1 trials are complete" in capsys.readouterr().out
    assert main(["identify", "last"]) == 7
    assert "runs/a.mcap" in capsys.readouterr().err


def test_python_runs_without_a_rig(folder: Path) -> None:
    told: list[str] = []
    recording = rigd.run("short.yaml", notify=told.append)
    assert recording.info.rig == "lugre-1"
    assert told == ["no --rig: simulated on lugre-1, nothing moves"]


def test_output_makes_its_folder(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "short.yaml", "--output", "new/runs/x.mcap"]) == 0
    assert (folder / "new" / "runs" / "x.mcap").is_file()
    (folder / "file").touch()
    assert main(["run", "short.yaml", "--output", "file/x.mcap"]) == 7
    assert "cannot make the folder file" in capsys.readouterr().err


def test_errors_of_remote_stand_beside_its_clients() -> None:
    """As docs/remote.md names them."""
    assert issubclass(rigd.remote.Refusal, RigdError)
    assert issubclass(rigd.remote.LinkError, RigdError)
