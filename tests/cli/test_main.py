"""The command line: help that teaches, nothing heavy imported for it, errors without tracebacks."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.commands.command import rigd

from rigd import __version__
from rigd.cli import main as cli
from rigd.cli.options import expanded
from rigd.model.errors import Exit

COMMANDS = [cli.command_name(command) for command in cli.COMMANDS]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_teaches_by_example(command: str, tmp_path: Path) -> None:
    shown = rigd(command, "--help", cwd=tmp_path)
    assert shown.code == 0
    assert "example" in shown.out
    assert f"rigd {command}" in shown.out


def test_help_names_every_command_and_every_exit_code(tmp_path: Path) -> None:
    shown = rigd("--help", cwd=tmp_path).out
    for command in COMMANDS:
        assert f"  {command}" in shown
    for code in Exit:
        assert f"{int(code)}  " in shown


@pytest.mark.parametrize(
    ("command", "given"),
    [("import", "x.csv --map m.yaml"), ("remote list", ""), ("can eds", "drive.eds")],
)
def test_unknown_option_shows_usage_of_its_command(
    command: str, given: str, tmp_path: Path
) -> None:
    shown = rigd(*command.split(), *given.split(), "--force", cwd=tmp_path)
    assert shown.code == Exit.BAD_INPUT
    assert shown.err.startswith(f"usage: rigd {command} [-h]")
    assert f"rigd {command}: error: unrecognized arguments: --force" in shown.err


def test_every_option_has_a_help_of_its_own() -> None:
    texts = [
        (parser.prog, action.help)
        for parser in every_parser(cli.build_parser())
        for action in parser._actions
        if action.option_strings and action.help is not None
    ]
    assert len(texts) > 100
    assert [text for text, times in Counter(texts).items() if times > 1] == []


def every_parser(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                yield from every_parser(command)


def test_help_and_version_import_nothing_heavy(tmp_path: Path) -> None:
    script = (
        "import sys\n"
        "from rigd.cli.main import build_parser\n"
        "build_parser().format_help()\n"
        "heavy = {'numpy', 'scipy', 'numba', 'pydantic', 'mcap', 'rich', 'pyarrow', 'matplotlib'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert done.stdout.strip() == "[]"
    assert rigd("--version", cwd=tmp_path).out.strip() == f"rigd {__version__}"


def test_checking_a_file_imports_no_numerics(tmp_path: Path) -> None:
    script = (
        "import sys\n"
        "from rigd.cli.main import main\n"
        "main(['check', 'constant_current', '--rig', 'lugre-1'])\n"
        "heavy = {'numpy', 'scipy', 'numba', 'mcap', 'rich', 'pyarrow', 'matplotlib'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert done.stdout.strip().splitlines()[-1] == "[]"


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh", "fish"])
def test_completion_scripts_know_every_command(shell: str, tmp_path: Path) -> None:
    script = rigd("completion", shell, cwd=tmp_path)
    assert script.code == 0
    for command in COMMANDS:
        assert command in script.out


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        ("ide", ["identify"]),
        ("check pu", ["pull.yaml", "pulls"]),
        ("run --rig pull.", ["pull.yaml"]),
        ("run pull.yaml --output pull.", ["pull.yaml"]),
        ("run --compression l", ["lz4"]),
        ("remote status --rig pull.", ["pull.yaml"]),
    ],
)
def test_bash_completion_completes_commands_and_files(
    tmp_path: Path, words: str, completed: list[str]
) -> None:
    (tmp_path / "rigd.bash").write_text(rigd("completion", "bash", cwd=tmp_path).out)
    (tmp_path / "pull.yaml").touch()
    (tmp_path / "pulls").mkdir()
    done = subprocess.run(
        [
            "bash", "-c",
            f"source rigd.bash; COMP_WORDS=(rigd {words}); COMP_CWORD={len(words.split())}; "
            '_shtab_rigd 2>/dev/null; echo "${COMPREPLY[@]}"',
        ],
        cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert sorted(done.stdout.split()) == completed


def test_unexpected_exception_is_reported_as_bug(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ZeroDivisionError("oops")

    monkeypatch.setattr("rigd.config.loader.load_rig", broken)
    code = cli.main(["check", "lugre-1", "--rig", "lugre-1"])
    assert code == Exit.INTERNAL
    assert "this is a bug in rigd" in capsys.readouterr().err


def test_closed_output_pipe_is_no_error(tmp_path: Path) -> None:
    done = subprocess.run(
        f"{sys.executable} -m rigd schema rig | head -1",
        shell=True, cwd=tmp_path, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert done.stdout == "{\n"
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (["runn", "quick"], "unknown command 'runn', did you mean `rigd run`?"),
        (["remote", "statsu"], "unknown command 'statsu', did you mean `rigd remote status`?"),
        (["export", "x", "--to", "parket"], "did you mean `parquet`?"),
        (["zzz"], "unknown command 'zzz'"),
    ],
)
def test_misspelt_command_gets_a_suggestion(
    given: list[str], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(given)
    assert ended.value.code == Exit.BAD_INPUT
    assert meant in capsys.readouterr().err


@pytest.mark.parametrize("given", [[], ["remote"]], ids=["rigd", "rigd remote"])
def test_without_a_command_the_help_is_shown(
    given: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(given)
    assert ended.value.code == Exit.OK
    assert "examples:" in capsys.readouterr().out


def test_pattern_names_the_files_that_fit(tmp_path: Path) -> None:
    for name in ("b.mcap", "a.mcap", "a[1].mcap", "c.csv"):
        (tmp_path / name).touch()
    given = [tmp_path / "[ab].mcap", tmp_path / "a[1].mcap", tmp_path / "*.mat"]
    names = ["a.mcap", "b.mcap", "a[1].mcap", "*.mat"]
    assert [path.name for path in expanded(given)] == names


#: Ctrl-C comes when the module that is given is imported.
INTERRUPTED = """
import os, signal, sys
class CtrlC:
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[1]:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, CtrlC())
from rigd.__main__ import main
sys.argv = ["rigd", "runs"]
sys.exit(main())
"""


@pytest.mark.parametrize(
    "module", ["rigd.cli.options", "rigd.model.errors", "rigd.cli.views.output"]
)
def test_ctrl_c_during_imports_gives_no_traceback(module: str, tmp_path: Path) -> None:
    script = INTERRUPTED.replace("sys.argv[1]", repr(module))
    command = [sys.executable, "-c", script]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert (ended.returncode, ended.stderr) == (Exit.STOPPED, "rigd: interrupted\n")


#: Ctrl-C once the result is shown: while the interpreter joins its threads, and as it ends.
LATE = """
import atexit, os, signal, sys, threading
def press():
    os.kill(os.getpid(), signal.SIGINT)
atexit.register(press)
threading._register_atexit(press)
from rigd.__main__ import main
sys.argv = ["rigd", *WORDS]
sys.exit(main())
"""


@pytest.mark.parametrize(("words", "code"), [(["schema", "procedure"], 0), (["schema", "x"], 2)])
def test_ctrl_c_behind_the_result_changes_nothing(
    words: list[str], code: int, tmp_path: Path
) -> None:
    command = [sys.executable, "-c", LATE.replace("WORDS", repr(words))]
    ended = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert ended.returncode == code, ended.stderr
    assert "KeyboardInterrupt" not in ended.stderr
