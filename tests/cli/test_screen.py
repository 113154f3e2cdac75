"""What stands in a narrow terminal: every word whole, no line cut, what goes on indented."""

from __future__ import annotations

import io
from collections import Counter
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table
from support.commands.command import rigd
from support.commands.terminal import Terminal

from rigd.cli.main import main
from rigd.cli.views.screen import print_rows, print_table, shared, wrapped

RECORDING = "runs/20261121-080000-constant_current-a_name_that_is_long.mcap"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("narrow")
    (folder / "runs").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(["run", "quick", "--rig", "lugre-1", "--quiet", "--output", RECORDING]) == 0
    return folder


def shown(folder: Path, columns: int, *words: str) -> list[str]:
    """Return the lines of a command on a terminal of so many columns."""
    terminal = Terminal.open(words, folder, columns=columns)
    try:
        assert terminal.end() == 0
        return terminal.seen.splitlines()
    finally:
        terminal.close()


@pytest.mark.parametrize(
    "words", [("runs",), ("info", RECORDING), ("drivers",), ("drivers", "serial-scale")],
    ids=["runs", "info", "drivers", "driver"],
)  # fmt: skip
def test_no_word_is_cut_in_a_narrow_terminal(folder: Path, words: tuple[str, ...]) -> None:
    whole = Counter(" ".join(shown(folder, 300, *words)).split())
    lines = shown(folder, 60, *words)
    assert "…" not in "".join(lines)
    assert Counter(" ".join(lines).split()) == whole


def test_recordings_fit_eighty_columns(folder: Path) -> None:
    """A path alone may be wider: it is one word, and has a line of its own."""
    lines = [line.rstrip() for line in shown(folder, 80, "runs")]
    assert RECORDING in lines
    assert max(len(line) for line in lines) <= 80


def test_column_that_no_recording_fills_is_absent(folder: Path) -> None:
    heading = rigd("runs", cwd=folder).out.splitlines()[0].split()
    assert heading[:2] == ["recording", "recorded"]
    assert not {"set", "meta"} & set(heading)


def test_cells_below_a_long_name_stay_in_columns() -> None:
    table = Table(box=None, pad_edge=False)
    for name in ("recording", "procedure", "state"):
        table.add_column(name)
    table.add_column("MB", justify="right")
    table.add_row("a" * 30, "quick", "complete", "1.5")
    table.add_row("b" * 30, "constant_current", "stopped", "20.8")
    screen = io.StringIO()
    print_rows(Console(file=screen, width=40), table)
    assert [line.rstrip() for line in screen.getvalue().splitlines()] == [
        "recording",
        "  procedure         state       MB",
        "a" * 30,
        "  quick             complete   1.5",
        "b" * 30,
        "  constant_current  stopped   20.8",
    ]


def test_table_narrower_than_terminal_keeps_to_it() -> None:
    lines = drawn(40, "a few words that wrap in their column").splitlines()
    assert max(map(len, lines)) <= 40
    assert len(lines) > 2


def test_a_table_wider_than_the_terminal_stays_whole() -> None:
    word = "a_long_name_of_a_channel.position"
    assert [line.split() for line in drawn(40, word).splitlines()] == [
        ["parameter", "where"], [word, word]
    ]  # fmt: skip


def test_an_indented_name_is_not_cut() -> None:
    table = Table("option", "meaning", box=None, pad_edge=False)
    table.add_row("  data_bits", "a_setting_of_the_scale in its menu")
    screen = io.StringIO()
    print_table(Console(file=screen, width=34), table)
    assert "data_bits" in screen.getvalue().split()


@pytest.mark.parametrize(
    ("room", "widths"), [(100, [4, 30, 12]), (30, [4, 14, 12]), (20, [4, 9, 7]), (5, [4, 6, 5])]
)
def test_columns_share_the_remaining_width(room: int, widths: list[int]) -> None:
    assert shared(room, least=[4, 6, 5], most=[4, 30, 12]) == widths


def drawn(width: int, text: str) -> str:
    table = Table("parameter", "where", box=None)
    table.add_row(text, text)
    screen = io.StringIO()
    print_table(Console(file=screen, width=width), table)
    return screen.getvalue()


def test_continuation_lines_are_indented_further() -> None:
    text = "warnings:\n  clean_0: the wheel slides in 2 of 2 runs, need 5 for a maximum"
    assert wrapped(text, 40) == (
        "warnings:\n  clean_0: the wheel slides in 2 of 2\n    runs, need 5 for a maximum"
    )
    assert wrapped(text, 80) == text
