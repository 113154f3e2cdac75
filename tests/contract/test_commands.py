"""What each command prints of itself, of what is installed, and of what it refuses."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import pytest
from contract.golden import Check
from contract.transcript import Transcript
from support.wrong_rigs import MISTAKES, spoilt

from rigd.cli.main import COMMANDS, build_parser, command_name
from rigd.sdk.shipped_files import shipped_folder

#: Commands with wrong arguments, missing files and files of another kind.
REFUSED = (
    "", "nothing", "run", "run nothing", "run quick --rig nothing", "run quick --set floor=pvc",
    "run quick --rig lugre-1 --seed x", "check", "check nothing.yaml", "check text.txt",
    "info nothing.mcap", "info text.txt", "identify nothing.mcap", "identify text.txt",
    "measure text.txt", "validate text.txt text.txt", "validate nothing.json text.txt",
    "compare text.txt", "design --minutes 1", "report text.txt", "verify text.txt",
    "recover text.txt", "export text.txt --to csv", "export text.txt --to nothing",
    "import text.txt", "import text.txt --map text.txt", "note text.txt x", "filter text.txt",
    "calibrate", "calibrate --from text.txt", "drivers nothing", "analyses nothing",
    "can eds text.txt", "layout nothing --to foxglove", "schema nothing", "new driver 9x",
    "completion nothing", "jog", "jog wheel_servo.current=1V --rig lugre-1", "tare nothing",
    "read --rig nothing", "sim nothing", "serve --rig nothing", "remote start quick",
)  # fmt: skip


@pytest.mark.parametrize("command", [command_name(command) for command in COMMANDS])
def test_help_of_command_is_as_before(command: str, tmp_path: Path, unchanged: Check) -> None:
    transcript = Transcript(tmp_path)
    for words in _commands(build_parser()):
        if words.split()[0] == command:
            transcript.play(f"{words} --help")
    unchanged(command, transcript.text)


def test_lists_are_as_before(tmp_path: Path, unchanged: Check) -> None:
    transcript = Transcript(tmp_path)
    for command in ("--help", "drivers", "analyses", "completion bash", "completion zsh"):
        transcript.play(command)
    for kind in ("drivers", "analyses"):
        transcript.play(f"{kind} --json")
    for schema in ("procedure", "rig", "calibration", "map", "remote"):
        transcript.play(f"schema {schema}", quiet=True)
    unchanged("lists", transcript.text)


def test_refusals_are_as_before(tmp_path: Path, unchanged: Check) -> None:
    (tmp_path / "text.txt").write_text("not what you think\n", "utf-8")
    transcript = Transcript(tmp_path)
    for command in REFUSED:
        transcript.play(command)
    unchanged("refusals", transcript.text)


def test_mistakes_in_rig_files_are_named_as_before(tmp_path: Path, unchanged: Check) -> None:
    transcript = Transcript(tmp_path)
    for number, (name, old, new) in enumerate(MISTAKES):
        text, _, _ = spoilt(name, old, new)
        (tmp_path / f"{name}_{number}.yaml").write_text(text, "utf-8")
    for folder in ("plants", "eds", "calibrations"):
        (tmp_path / folder).symlink_to(shipped_folder("configs") / folder)
    for path in sorted(tmp_path.glob("*.yaml")):
        transcript.play(f"check {path.name}")
    unchanged("mistakes", transcript.text)


def _commands(parser: argparse.ArgumentParser, words: str = "") -> Iterator[str]:
    """Yield the words of each command and of each below it."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield f"{words} {name}".strip()
                yield from _commands(below, f"{words} {name}".strip())
