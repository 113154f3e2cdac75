"""Each hint of a command leads to what was asked for or to another refusal, not to a wrong result.

A case runs a command that is refused, asserts its hint, and follows it: `walk` are commands that
the hint names, each with the code that it must end with, and words that it must print. The hints of
the import have a test of their own, `tests/importing/test_hints.py`.
"""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from support.commands.command import Ended, rigd

from rigd.model import Channel, Stream
from rigd.model.rows import row_dtype
from rigd.record import Attachment, RecordingWriter
from rigd.sdk.shipped_files import shipped_folder

FORCE = Stream("force", (Channel("force", "N"), Channel("speed", "m/s")))
START_NS = 10**18
ROCRATE = "export a.mcap --to rocrate --output c.zip"
LICENSED = f"{ROCRATE} --license CC-BY-4.0"


@dataclass(frozen=True)
class Case:
    """A command line that is refused, its hint, and what that says to do, line by line."""

    line: str
    hint: str
    walk: Sequence[tuple[str, int, str]]  #: line, exit code, words that it prints
    env: Mapping[str, str] = field(default_factory=dict)  #: of the refused command alone


CASES = {
    "folder in place of a file": Case(
        "info runs", "`rigd runs runs` lists its recordings", [("runs runs", 0, "b.mcap")]
    ),
    "cut file": Case(
        "note cut.mcap hello", "`rigd verify cut.mcap` lists the damage. `rigd recover cut.mcap`",
        [("verify cut.mcap", 7, "damaged"), ("recover cut.mcap", 0, "cut.mcap"),
         ("verify cut.mcap", 0, "whole"), ("note cut.mcap hello", 0, "hello")],
    ),
    "text in place of a recording": Case(
        "info text.mcap", "`rigd verify text.mcap` lists the damage",
        [("verify text.mcap", 7, "text.mcap"), ("recover text.mcap", 7, "no MCAP recording")],
    ),
    "exported already": Case(
        "export a.mcap --to csv --output there", "Choose another --output, or give --overwrite",
        [("export a.mcap --to csv --output other", 0, "other/force.csv"),
         ("export a.mcap --to csv --output there --overwrite", 0, "there/force.csv")],
    ),
    "no such stream": Case(
        "export a.mcap --to csv --output x --stream forse", "did you mean 'force'?",
        [("export a.mcap --to csv --output x --stream force", 0, "x/force.csv")],
    ),
    "too many rows": Case(
        "export a.mcap --to csv --output x --rate 1e12", "choose a lower rate",
        [("export a.mcap --to csv --output x --rate 1e3", 0, "csv")],
    ),
    "attachments of several": Case(
        "info a.mcap runs/b.mcap --attachments f", "give one FILE with --attachments",
        [("info a.mcap --attachments f", 0, "wrote f/rig.yaml")],
    ),
    "attachments are there": Case(
        "info a.mcap --attachments taken", "give --attachments another FOLDER",
        [("info a.mcap --attachments free", 0, "wrote free/rig.yaml")],
    ),
    "bound that is none": Case(
        "info a.mcap", "RIGD_CHUNK_MIB=64 is what rigd takes by itself",
        [("RIGD_CHUNK_MIB=64 info a.mcap", 0, "100")], env={"RIGD_CHUNK_MIB": "abc"},
    ),
    "unknown field": Case(
        "runs runs --where \"stat == x\"", "did you mean 'state'?",
        [("runs runs --where \"state == interrupted\"", 0, "b.mcap")],
    ),
    "last of too many": Case(
        "info last:5", "`last` is the newest, `last:3` are the three newest; --runs names another",
        [("info last", 0, "b.mcap"), ("info last:1", 0, "b.mcap")],
    ),
    "no such procedure": Case(
        "check quik", "did you mean 'quick'?", [("check quick", 0, "quick")]
    ),
    "no such rig": Case(
        "check quick --rig lugre_1", "did you mean", [("check quick --rig lugre-1", 0, "quick")]
    ),
    "no such file to check": Case(
        "check quick.yaml", "to use the shipped procedure, give its name: quick",
        [("check quick", 0, "quick")],
    ),
    "no rig to serve": Case(
        "serve", "give --rig RIG, set RIGD_RIG, or write `default_rig: RIG` into rigd.yaml",
        [("serve --rig lugre_1", 2, "did you mean 'lugre-1'?"),
         ("RIGD_RIG=lugre_1 serve", 2, "did you mean 'lugre-1'?")],
    ),
    "port that is none": Case(
        "serve --rig lugre-1 --panel-port 99999", "give a whole number from 0 to 65535",
        [("serve --rig lugre-1 --foxglove x", 2, "'x' is no port"),
         ("panel --rig lugre-1 --port -1", 2, "port")],
    ),
    "no folder of procedures to serve": Case(
        "serve --rig lugre-1 --procedures nothing", "make it, or leave --procedures out",
        [("serve --rig lugre-1 --procedures plans --runs text.mcap", 7, "choose another --runs")],
    ),
    "map to check, misspelt": Case(
        "check lugre_table.yaml", "give the path of a file, or the name of a shipped procedure",
        [("check plans/quick.yaml", 0, "right"), ("check quick", 0, "quick")],
    ),
    "misspelt file to check": Case(
        "check plans/quik.yaml", "did you mean 'plans/quick.yaml'?",
        [("check plans/quick.yaml", 0, "right")],
    ),
    "name of a driver": Case(
        "new driver Bad_Name", "use lower case letters and digits, words joined by a dash",
        [("new driver bad-name", 0, "bad-name")],
    ),
    "driver is there": Case(
        "new driver mine", "choose another name or --folder",
        [("new driver mine-2", 0, "mine-2"), ("new driver mine --folder no", 2, "create it first"),
         ("new driver mine --folder runs", 0, "runs/mine")],
    ),
    "no such driver": Case(
        "drivers analog-servos", "did you mean 'analog-servo'",
        [("drivers analog-servo", 0, "servo")],
    ),
    "no licence": Case(
        ROCRATE, "give --license, such as CC0-1.0 or CC-BY-4.0",
        [(LICENSED, 2, "give --author"), (f"{LICENSED} --author 'Ada Lovelace 0000-0002-1825-0097'",
                                          0, "c.zip")],
    ),
    "crate is there": Case(
        "export a.mcap --to rocrate --output old.zip --license CC0-1.0 --author Ada",
        "--overwrite replaces it",
        [("export a.mcap --to rocrate --output old.zip --license CC0-1.0 --author Ada --overwrite",
          0, "old.zip")],
    ),
    "nothing to identify": Case(
        "identify a.mcap", "`rigd identify a.mcap --plan PROCEDURE`; `rigd info a.mcap` shows",
        [("identify a.mcap --plan quick", 7, "`identify` block"), ("info a.mcap", 0, "force")],
    ),
    "nothing to measure": Case(
        "measure a.mcap", "`rigd measure FILE --plan PROCEDURE`",
        [("measure a.mcap --plan breakaway", 7, "no trial")],
    ),
    "nothing to compare": Case(
        "compare a.mcap runs/b.mcap", "`rigd measure FILE --plan PROCEDURE`",
        [("measure a.mcap --plan breakaway", 7, "no trial")],
    ),
    "given twice": Case(
        "compare a.mcap a.mcap", "give it once",
        [("compare a.mcap", 7, "carries no procedure")],
    ),
    "trials that are none": Case(
        "report a.mcap --trials x", "write --trials 1,4,7-9",
        [("report a.mcap --trials 1", 7, "has no trial 1")],
    ),
    "no rig": Case(
        "tare x", "give --rig RIG, set RIGD_RIG, or write `default_rig: RIG` into rigd.yaml",
        [("tare x --rig lugre-1", 2, "lugre-1 has no device 'x'"),
         ("RIGD_RIG=lugre-1 tare x", 2, "lugre-1 has no device 'x'")],
    ),
    "no such parameter": Case(
        "run quick --rig lugre-1 --dry-run --set flor=1", "known: current",
        [("run quick --rig lugre-1 --dry-run --set 'current=0.4 A'", 0, "")],
    ),
    "value without unit": Case(
        "run quick --rig lugre-1 --dry-run --set current=0.4", "such as '1 A'",
        [("run quick --rig lugre-1 --dry-run --set 'current=1 A'", 0, "")],
    ),
    "value given twice": Case(
        "run quick --rig lugre-1 --dry-run --meta a=1 --meta a=2", "write --meta 'a=A, B'",
        [("run quick --rig lugre-1 --dry-run --meta 'a=1, 2'", 0, "")],
    ),
    "unknown command": Case(
        "exprot a.mcap", "did you mean `rigd export`?", [("export --help", 0, "--to")]
    ),
    "empty file": Case(
        "verify empty.mcap", "Nothing was recorded", [("recover empty.mcap", 7, "can be deleted")]
    ),
    "folder to check": Case(
        "check plans", "check the files in this folder: plans/*.yaml",
        [("check plans/quick.yaml", 0, "right")],
    ),
}  # fmt: skip


def record(path: Path) -> None:
    about = {"run": {"procedure": "sweep", "rig": "bench", "title": path.stem}}
    attached = [Attachment("rig.yaml", "application/yaml", b"rig: bench\n")]
    with RecordingWriter.create(
        path, streams=[FORCE], metadata=about, attachments=attached, start_ns=START_NS
    ) as writer:
        rows = np.zeros(100, row_dtype(FORCE))
        rows["t_ns"] = START_NS + np.arange(100) * 10**6
        writer.write("force", rows)
        writer.event(START_NS, "run_start", data={"procedure": "sweep"})


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with recordings, whole, cut off and none, and results that are there already."""
    for name in ("HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / "home"))
    monkeypatch.delenv("RIGD_RIG", raising=False)
    for name in ("runs", "there", "taken", "mine", "plans"):
        (tmp_path / name).mkdir()
    record(tmp_path / "a.mcap")
    record(tmp_path / "runs" / "b.mcap")
    content = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[:-60])
    (tmp_path / "text.mcap").write_text("hello")
    for name in ("empty.mcap", "there/force.csv", "taken/rig.yaml", "old.zip"):
        (tmp_path / name).touch()
    shutil.copy(shipped_folder("procedures") / "quick.yaml", tmp_path / "plans")
    return tmp_path


def ran(line: str, cwd: Path, monkeypatch: pytest.MonkeyPatch) -> Ended:
    words = shlex.split(line)
    with monkeypatch.context() as given:
        while words[0].partition("=")[0].isupper():
            name, _, value = words.pop(0).partition("=")
            given.setenv(name, value)
        return rigd(*words, cwd=cwd)


@pytest.mark.parametrize("name", CASES)
def test_hint_of_command_leads_on(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = CASES[name]
    given = " ".join(f"{variable}={value}" for variable, value in case.env.items())
    refused = ran(f"{given} {case.line}", folder, monkeypatch)
    assert refused.code != 0
    assert case.hint in " ".join(refused.err.split())
    for line, code, says in case.walk:
        ended = ran(line, folder, monkeypatch)
        said = " ".join(f"{ended.out} {ended.err}".split())
        assert (ended.code, says in said) == (code, True), f"{line}: {ended.code} {said}"
