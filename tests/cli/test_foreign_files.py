"""What commands give of a recording is the same however another program wrote its messages."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from support.cases import some
from support.commands.odd_commands import COMMANDS, of_run
from support.recordings.odd_mcap import VALID, Content, content_of
from support.recordings.shipped_runs import Pair, play

from rigd.config.loader import load_rig
from rigd.sdk.shipped_files import shipped_folder


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Content]:
    """A recording of rigd, another one, and what the first holds."""
    folder = tmp_path_factory.mktemp("played")
    rig = load_rig(shipped_folder("configs") / "sim_lugre.yaml")
    paths = []
    for seed, name in enumerate(("a.mcap", "b.mcap"), 1):
        paths.append(folder / str(seed) / name)
        paths[-1].parent.mkdir()
        play(Pair(shipped_folder("procedures") / "breakaway.yaml", rig), seed, paths[-1], trials=2)
    return paths[0], paths[1], content_of(paths[0])


@pytest.mark.parametrize("name", some(list(VALID), 9, 3))
def test_commands_give_the_same_of_odd_file(
    name: str, played: tuple[Path, Path, Content], tmp_path: Path
) -> None:
    ours, other, content = played
    theirs = tmp_path / "a.mcap"
    VALID[name](content, theirs)
    os.utime(theirs, ns=(ours.stat().st_mtime_ns,) * 2)  # a run in virtual time has that date
    for command, call in COMMANDS.items():
        if command == "report":  # two seconds each: `benchmarks/foreign_recording.py --odd`
            continue
        assert of_run(call(theirs, other)) == of_run(call(ours, other)), command
