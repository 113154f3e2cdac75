"""Each command that writes a file makes the folder of it, or says why it cannot."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.commands.command import rigd

#: A command that writes FILE, which stands in a folder that is not there.
COMMANDS = {
    "a.html": "report RUN --output FILE",
    "a.json": "layout RUN --to foxglove --output FILE",
    "a.mat": "export RUN --to mat --output FILE",
    "a.csv": "export RUN --to csv --output FILE",
    "a.xml": "measure RUN --junit FILE",
    "b.html": "compare RUN RUN2 --report FILE",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("outputs")
    made = "run breakaway --rig lugre-1 --output new/runs/RUN.mcap --junit new/results/a.xml"
    for seed, name in enumerate(("a", "b"), 1):
        done = rigd(*made.replace("RUN", name).split(), "--seed", str(seed), cwd=folder)
        assert (folder / "new/runs" / f"{name}.mcap").is_file(), done.err
        assert (folder / "new/results/a.xml").is_file()
    return folder


def filled(command: str, file: str) -> list[str]:
    words = {"RUN": "new/runs/a.mcap", "RUN2": "new/runs/b.mcap", "FILE": file}
    return [words.get(word, word) for word in command.split()]


@pytest.mark.parametrize(("name", "command"), COMMANDS.items())
def test_command_makes_folder_of_its_file(folder: Path, name: str, command: str) -> None:
    file = f"of-{name}/deeper/{name}"
    done = rigd(*filled(command, file), cwd=folder)
    assert (folder / file).exists(), done.err


@pytest.mark.parametrize(("name", "command"), COMMANDS.items())
def test_folder_that_is_a_file_is_named(folder: Path, name: str, command: str) -> None:
    (folder / "taken").write_text("")
    done = rigd(*filled(command, f"taken/{name}"), cwd=folder)
    assert done.code in (2, 7), done.err
    assert "taken" in done.err
    assert "internal error" not in done.err
