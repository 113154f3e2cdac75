"""Everything in docs/ runs: commands, Python and files, in the order in which they stand.

The info string of a fenced block decides what becomes of it:

- ``sh``: run with ``sh -eu`` in the document's folder; ``exit=N`` if it must end with N; of a
  document in ``ONE_TERMINAL`` in the folder in which the block before it ended;
- ``python``: run in that folder, warnings are errors;
- ``python file=NAME``: a module, written to that folder for the commands behind it;
- ``yaml file=NAME``: a whole file, written to that folder and checked (``rig=NAME``: on that rig);
- ``yaml map file=NAME``: the same of a map of ``rigd import``;
- ``yaml part``: top-level keys, put in place of those of a small procedure or of the shipped rig,
  which is then checked;
- ``text output``: what the ``sh`` block before it printed; ``...`` is any text, also of many lines;
- ``yaml fragment source=PATH``: the file at PATH of the checkout, word for word;
- ``yaml fragment`` and ``text``: for people; counted, so that none is left unchecked by accident;
- ``{toctree}``: for the site (``make docs``), whose build checks it.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from support import warm
from support.commands.command import rigd
from support.daemon.served_lugre import served_lugre

from rigd.cli.main import COMPILING
from rigd.config.document import parse_document
from rigd.config.loader import load_rig, parse_rig
from rigd.config.source import RigSource
from rigd.importing import load_map
from rigd.model import ConfigError
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.sdk.shipped_files import shipped_folder

DOCS = Path(__file__).resolve().parents[2] / "docs"
DOCUMENTS = (
    "index.md",
    "install.md",
    "other_systems.md",
    "tutorial.md",
    "procedures.md",
    "rigs.md",
    "derived.md",
    "observers.md",
    "controllers.md",
    "recordings.md",
    "python.md",
    "import.md",
    "catalogue.md",
    "export.md",
    "identification.md",
    "slip_force.md",
    "lateral.md",
    "approach_angle.md",
    "robot.md",
    "validation.md",
    "compare.md",
    "drivers.md",
    "analyses.md",
    "friction_laws.md",
    "plants.md",
    "new_rig.md",
    "mechanism.md",
    "models.md",
    "simulation.md",
    "devices.md",
    "faults.md",
    "foreign.md",
    "calibration.md",
    "foxglove.md",
    "protocol.md",
    "daemon.md",
    "panel.md",
    "remote.md",
    "ci.md",
    "glossary.md",
    "testing.md",
)
#: Documents whose commands need a daemon: that of lugre-1, which clients find by its name.
SERVED = frozenset({"remote.md"})
#: Blocks that nothing runs, by document.
UNCHECKED = {
    "index.md": 0,
    "install.md": 4,
    "other_systems.md": 0,
    "tutorial.md": 3,
    "procedures.md": 1,
    "rigs.md": 0,
    "derived.md": 0,
    "observers.md": 0,
    "controllers.md": 0,
    "recordings.md": 0,
    "python.md": 0,
    "catalogue.md": 0,
    "export.md": 0,
    "import.md": 2,
    "identification.md": 2,
    "slip_force.md": 0,
    "lateral.md": 0,
    "robot.md": 0,
    "approach_angle.md": 0,
    "validation.md": 1,
    "compare.md": 0,
    "drivers.md": 4,
    "analyses.md": 0,
    "friction_laws.md": 1,
    "testing.md": 0,
    "new_rig.md": 1,
    "mechanism.md": 0,
    "plants.md": 3,
    "models.md": 1,
    "simulation.md": 11,
    "devices.md": 14,
    "faults.md": 1,
    "foreign.md": 0,
    "calibration.md": 0,
    "foxglove.md": 2,
    "glossary.md": 0,
    "protocol.md": 1,
    "daemon.md": 3,
    "panel.md": 1,
    "remote.md": 1,
    "ci.md": 0,
}
#: Documents whose commands and Python are processes of their own from the start, as a reader's.
COLD = frozenset({"drivers.md", "plants.md", "simulation.md", "faults.md"})
#: Documents whose commands are typed in one terminal: `cd` holds for all that follow.
ONE_TERMINAL = frozenset({"tutorial.md"})
#: Commands of the tutorial that play the rig or read a recording of it: they take most of its time.
PLAYS = re.compile(r"^(rigd (run|measure|report|info)|\./try)\b", re.M)
TIMEOUT_S = 240

_FENCE = re.compile(
    r"^(?P<indent> *)```(?P<info>[^`\n]*)\n(?P<body>.*?)^(?P=indent)```$", re.M | re.S
)
_LINK = re.compile(r"\]\((?!https?://)(?P<file>[^)#\s]*)(?:#(?P<anchor>[^)\s]+))?\)")
_TOP_KEY = re.compile(r"^([a-z]+):", re.M)

#: What ``yaml part`` blocks of procedures are put into.
SKELETON = """\
procedure: part
title: A part of the documentation
doc: Checked with the rest of a small procedure around it.
parameters:
  floor: {doc: Floor, choices: [stone, pvc, paperboard], default: stone}
  current: {doc: Current, unit: A, default: 0.5 A, min: 0.1 A, max: 1.5 A}
trial:
  steps:
    - step: drive
      set: {wheel_servo.current: "${current}"}
      for: 0.1 s
"""


@dataclass(frozen=True)
class Block:
    """One fenced block: the words of its info string, its text, and the line it begins in."""

    words: tuple[str, ...]
    body: str
    line: int

    @property
    def kind(self) -> str:
        """What becomes of it."""
        if self.options.keys() >= {"file"}:
            return f"{self.words[0]} file"
        return " ".join(word for word in self.words if "=" not in word)

    @property
    def options(self) -> dict[str, str]:
        """The ``name=value`` words."""
        return dict(word.split("=", 1) for word in self.words if "=" in word)


def blocks(name: str) -> list[Block]:
    """Return the fenced blocks of a document in order."""
    text = (DOCS / name).read_text("utf-8")
    found = []
    for match in _FENCE.finditer(text):
        indent = match["indent"]
        body = "".join(line.removeprefix(indent) for line in match["body"].splitlines(True))
        line = text.count("\n", 0, match.start()) + 1
        found.append(Block(tuple(match["info"].split()), body, line))
    return found


def folder_of_checkout(folder: Path) -> Path:
    """Make ``folder`` look like the checkout, as far as the documents name its folders."""
    (folder / "configs").symlink_to(shipped_folder("configs"))
    (folder / "procedures").symlink_to(shipped_folder("procedures"))
    (folder / "examples").symlink_to(DOCS.parent / "examples")
    return folder


def ended(command: list[str], folder: Path, expected: int) -> str:
    """Run a command and return what it printed, both streams; it must end with ``expected``."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return _ended(command, folder, expected, path)


def ended_in_shell(script: str, folder: Path, expected: int) -> str:
    """Do the same with a script, whose rigd does not import all again."""
    with warm.in_shell() as first:
        path = os.pathsep.join((str(first), str(Path(sys.executable).parent), os.environ["PATH"]))
        return _ended(["sh", "-euc", script], folder, expected, path)


def _ended(command: list[str], folder: Path, expected: int, path: str) -> str:
    done = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, "PATH": path},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert done.returncode == expected, done.stdout
    assert "Traceback" not in done.stdout, done.stdout
    return done.stdout.replace(f"{COMPILING}\n", "")  # shown once, wherever that is


def is_shown(printed: str, shown: str) -> bool:
    """Return whether a document shows what was printed, blanks at the ends of lines aside."""
    given, wanted = (re.sub(r" +$", "", text, flags=re.M) for text in (printed, shown))
    parts = (re.escape(part) for part in re.split(r"^\.\.\.\n|\.\.\.", wanted, flags=re.M))
    return re.fullmatch(".*?".join(parts), given, re.S) is not None


def with_part(whole: str, part: str) -> str:
    """Return ``whole`` with the top-level keys of ``part`` in place of its own."""
    given = set(_TOP_KEY.findall(part))
    kept = [
        piece
        for piece in re.split(r"(?m)^(?=[a-z]+:)", whole)
        if not given.intersection(_TOP_KEY.findall(piece))
    ]
    return "".join(kept) + part


def check_part(part: str, folder: Path) -> None:
    """Check the top-level keys of a rig or procedure file, with the rest of a file around them."""
    rig = load_rig("lugre-1")
    if set(_TOP_KEY.findall(part)) <= RigSource.model_fields.keys():
        parse_rig(with_part(rig.source.text, part), rig.source.path)
        return
    file = folder / "part.yaml"
    file.write_text(with_part(SKELETON, part), "utf-8")
    compile_procedure(load_procedure(file), rig)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_every_block_gives_its_printed_result(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = folder_of_checkout(tmp_path)
    if name not in SERVED:
        check_blocks(name, folder)
        return
    home = tmp_path / "home"
    monkeypatch.setenv("XDG_CONFIG_HOME", str(home))
    with served_lugre(home):
        check_blocks(name, folder)


def test_files_in_tutorial_are_those_that_rigd_writes(tmp_path: Path) -> None:
    check_blocks("tutorial.md", folder_of_checkout(tmp_path), without=PLAYS)


def check_blocks(name: str, folder: Path, without: re.Pattern[str] | None = None) -> None:
    """Check the blocks of a document in ``folder``; commands ``without`` and what they print not.

    Of a document in ``ONE_TERMINAL`` each block begins where the one before it ended.
    """
    printed = ""
    here, left = folder, folder / ".left"
    left_out = False
    for block in blocks(name):
        where = f"{name}:{block.line}"
        if block.kind == "sh":
            left_out = without is not None and without.search(block.body) is not None
        if left_out and block.kind in ("sh", "text output"):
            continue
        match block.kind:
            case "sh" if name in ONE_TERMINAL:
                expected = int(block.options.get("exit", "0"))
                script = f"trap 'pwd > {left}' EXIT\n{block.body}"
                try:
                    printed = ended_in_shell(script, here, expected)
                except AssertionError as error:
                    raise AssertionError(f"{where}\n{error}") from error
                here = Path(left.read_text("utf-8").strip())
            case "sh":
                expected = int(block.options.get("exit", "0"))
                try:
                    if name in COLD:
                        printed = ended(["sh", "-euc", block.body], folder, expected)
                    else:
                        printed = ended_in_shell(block.body, folder, expected)
                except AssertionError as error:
                    raise AssertionError(f"{where}\n{error}") from error
            case "python" if name in COLD:
                ended([sys.executable, "-W", "error", "-c", block.body], folder, 0)
            case "python":
                code, _, errors = warm.run_python(block.body, folder, TIMEOUT_S)
                assert code == 0, f"{where}\n{errors}"
            case "text output":
                assert is_shown(printed, block.body), f"{where}\n{printed}"
            case "python file":
                (folder / block.options["file"]).write_text(block.body, "utf-8")
            case "yaml file":
                (folder / block.options["file"]).parent.mkdir(exist_ok=True)
                (folder / block.options["file"]).write_text(block.body, "utf-8")
                if "map" in block.words:
                    load_map(folder / block.options["file"])
                    continue
                on = block.options.get("rig", "lugre-1")
                checked = rigd("check", block.options["file"], "--rig", on, cwd=folder)
                assert checked.code == 0, checked.out + checked.err
            case "yaml part":
                check_part(block.body, folder)
            case "yaml fragment" if "source" in block.options:
                assert (DOCS.parent / block.options["source"]).read_text("utf-8") == block.body
            case "yaml fragment" | "text" | "{toctree}":
                pass  # test_blocks_that_nothing_checks_are_known
            case other:
                pytest.fail(f"{where}: nothing is done with a block of {other!r}")


def test_blocks_that_nothing_checks_are_known() -> None:
    kinds = ("yaml fragment", "text")
    assert {
        name: sum(b.kind in kinds and "source" not in b.options for b in blocks(name))
        for name in DOCUMENTS
    } == UNCHECKED


def test_no_document_is_forgotten() -> None:
    assert {path.name for path in DOCS.glob("*.md")} == set(DOCUMENTS)


@pytest.mark.parametrize("name", DOCUMENTS)
def test_links_lead_somewhere(name: str) -> None:
    text = (DOCS / name).read_text("utf-8")
    for match in _LINK.finditer(text):
        if (match["file"] or "").startswith("reference/"):
            continue  # made by `make docs`; tests/docs/test_site.py checks these links
        target = DOCS / (match["file"] or name)
        assert target.is_file(), match[0]
        if match["anchor"]:
            titles = re.findall(r"^#+ (.+)$", target.read_text("utf-8"), re.M)
            anchors = {re.sub(r"[^\w -]", "", title).lower().replace(" ", "-") for title in titles}
            assert match["anchor"] in anchors, match[0]


def test_a_wrong_part_is_noticed(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no stream 'carrige'"):
        check_part("record:\n  carrige: 1\n", tmp_path)
    with pytest.raises(ConfigError, match=r"channel 'carrige\.position'"):
        check_part(
            "interlocks:\n"
            "  - {name: far, source: carrige.position, high: 1 m, action: stop, message: Far.}\n",
            tmp_path,
        )


def test_parts_replace_and_do_not_repeat_keys() -> None:
    whole = with_part(SKELETON, "parameters:\n  speed: {doc: Speed, default: 1}\n")
    data = parse_document(whole, Path("part.yaml")).data
    assert isinstance(data, dict)
    assert data["parameters"] == {"speed": {"doc": "Speed", "default": "1"}}
    assert "trial" in data


@pytest.mark.parametrize("code", ["exit 3", "echo Traceback", "rigd info nothing.mcap"])
def test_a_command_that_fails_is_noticed(code: str, tmp_path: Path) -> None:
    with pytest.raises(AssertionError):
        ended(["sh", "-euc", code], tmp_path, 0)
    with pytest.raises(AssertionError):
        ended_in_shell(code, tmp_path, 0)


@pytest.mark.parametrize(
    ("shown", "is_right"),
    [
        ("a\nb 1\nc\n", True),
        ("...\nc\n", True),
        ("a\nb ...\nc\n", True),
        ("a\n...\n", True),
        ("a\n", False),
        ("...\nd\n", False),
        ("b ...\nc\n", False),
    ],
)
def test_dots_stand_for_any_text(shown: str, is_right: bool) -> None:
    assert is_shown("a  \nb 1\nc\n", shown) is is_right
