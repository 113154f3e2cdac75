"""The progress of a run in a pipe: a line for each trial."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rigd.cli.views.run import RunDisplay, RunPosition


def position(trial: int, done: int) -> RunPosition:
    return RunPosition("running", trial, "speed 1 m/s", "drive", done, 12, None)


def test_trial_played_out_of_order_has_its_number(capsys: pytest.CaptureFixture[str]) -> None:
    """Messages, tables and `rigd identify` name a trial by its number."""
    with RunDisplay(quiet=False, paused="") as display:
        display.show(position(1, 0))
        display.show(position(8, 1))
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["trial 1/12: speed 1 m/s", "trial 2/12 (number 8): speed 1 m/s"]


@pytest.mark.parametrize(("done", "shown"), [(1, "ended"), (12, "done")])
def test_bar_of_a_stopped_run_ends(
    done: int, shown: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The conclusion says why; "done" beside 8 % would be wrong."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    with RunDisplay(quiet=False, paused="") as display:
        display.show(replace(position(1, done), trial=None, state="done"))
    screen = capsys.readouterr().err
    assert shown in screen
    assert ("done" in screen) == (shown == "done")
