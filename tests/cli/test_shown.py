"""Texts of others turn no line and steer no terminal, wherever they are shown."""

from __future__ import annotations

import io
import sys
from pathlib import Path

import pytest

from rigd.cli.main import main
from rigd.cli.views.output import Screen, screened
from rigd.record import RecordingWriter

#: Turns what follows it.
TURNED = "wheel\u202ecleaned"
STEERS = "cleaned\x1b[2J\x9b2J"


def test_letters_that_a_pipe_lacks_are_escaped(monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = io.BytesIO()
    monkeypatch.setattr("sys.stdout", io.TextIOWrapper(pipe, encoding="cp1252"))
    with screened():
        sys.stdout.write("σ of −2 µm\n")
        sys.stdout.flush()
    assert pipe.getvalue().decode("cp1252").strip() == r"\u03c3 of -2 µm"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A recording that another program may have made: rigd itself refuses such a note."""
    path = tmp_path / "run.mcap"
    RecordingWriter.create(
        path,
        streams=[],
        metadata={"run": {"procedure": TURNED, "rig": "bench", "note": f"{TURNED} {STEERS}"}},
        attachments=(),
        start_ns=1,
        sync_interval_s=None,
    ).close()
    return path


@pytest.mark.parametrize("command", ["info", "runs", "check"])
def test_control_characters_are_escaped_at_terminal(
    path: Path, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    named = {"runs": path.parent, "info": path, "check": path.parent / f"{TURNED}.yaml"}[command]
    main([command, str(named)])
    captured = capsys.readouterr()
    shown = captured.out + captured.err
    assert r"wheel\u202ecleaned" in shown
    assert not {"\u202e", "\x1b", "\x9b"} & set(shown)


def test_control_characters_are_escaped_on_page(path: Path) -> None:
    assert main(["report", str(path)]) == 0
    page = path.with_name("run-run.html").read_text(encoding="utf-8")
    assert r"wheel\u202ecleaned" in page
    assert r"cleaned\x1b[2J\x9b2J" in page
    assert not {"\u202e", "\x1b", "\x9b"} & set(page)


def test_colours_and_bars_of_rigd_stay() -> None:
    stream = io.StringIO()
    own = "\x1b[1;31mred\x1b[0m\r\x1b[2K\x1b[1A\x1b[?25l\n\tµ 日本 🧪"
    screen = Screen(stream)
    assert screen.write(own) == len(own)
    assert stream.getvalue() == own
    screen.write(STEERS)
    assert stream.getvalue() == own + r"cleaned\x1b[2J\x9b2J"
