"""What a recording states on its run, and finding runs by it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.cli.main import main
from rigd.model import Stream
from rigd.record import Event, Recording, RecordingWriter, trials
from rigd.record.read.info import run_state

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]


def play(writer: RecordingWriter, rows: NDArray[np.void], *, end: bool = True) -> None:
    """Record two trials of one second, of which the second stops half way."""
    start = int(rows["t_ns"][0])
    writer.event(start, "run_start")
    for number, complete in ((1, True), (2, False)):
        at = start + number * 1_000_000_000
        parameters = {"speed": 0.1 * number}
        data = {"repeat": 1, "parameters": parameters, "units": {"speed": "m/s"}}
        writer.event(at, "trial_start", number, data)
        ended = {"complete": complete, "reason": "carriage.position > 1.4 m"}
        writer.event(at + 500_000_000, "trial_end", number, ended)
    writer.write("wheel_servo", rows)
    if end:
        writer.event(int(rows["t_ns"][-1]), "run_end", None, {"state": "done", "reason": "all"})


def test_run_info_summarises_a_recording(
    create: Create, rows: MakeRows, servo: Stream, tmp_path: Path
) -> None:
    with create() as writer:
        play(writer, rows(servo, 4_001))
    info = Recording.open(tmp_path / "run.mcap").info
    assert (info.procedure, info.rig, info.mode) == ("sweep", "bench", "simulated")
    assert (info.state, info.reason, info.recovered) == ("done", "all", False)
    assert (info.trials_done, len(info.trials)) == (1, 2)
    assert info.trials[1].parameters == {"speed": 0.2}
    assert not info.trials[1].complete
    assert info.trials[1].reason == "carriage.position > 1.4 m"
    moved, pressed = info.streams
    assert (moved.stream.name, moved.rows, pressed.rows) == ("wheel_servo", 4_001, 0)
    assert moved.rate_hz == pytest.approx(1000.0)
    assert pressed.rate_hz == 0.0
    assert info.duration_s == pytest.approx(4.0)
    assert info.attachments == ("rig.yaml",)
    assert info.size == (tmp_path / "run.mcap").stat().st_size


@pytest.mark.parametrize("armed", [True, False])
def test_only_an_armed_run_takes_time(
    armed: bool,
    create: Create,
    rows: MakeRows,
    servo: Stream,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A run that is stopped in preflight has recorded rows, and nothing of it was played."""
    with create() as writer:
        start = int(rows(servo, 1)["t_ns"][0])
        if armed:
            writer.event(start, "run_start")
        writer.write("wheel_servo", rows(servo, 4_001))
        writer.event(start + 4_000_000_000, "run_end", None, {"state": "stopped"})
    took_s = Recording.open(tmp_path / "run.mcap").info.took_s
    assert took_s == (pytest.approx(4.0) if armed else None)
    assert main(["runs", str(tmp_path)]) == 0
    *_, seconds, _megabytes = capsys.readouterr().out.splitlines()[1].split()
    assert seconds == ("4" if armed else "0/?")


def test_trial_has_the_last_value_of_each_quantity() -> None:
    def said(t_ns: int, answer: object, changes: str = "load") -> Event:
        return Event(t_ns, "answer", data={"name": "q", "answer": answer, "changes": changes})

    found = trials(
        [
            Event(1, "run_start"),
            said(2, 4.0),
            Event(3, "trial_start", 1),
            said(4, 5.0),
            said(5, 5.02),  # asked again
            said(6, "nothing unusual", changes=""),
            Event(7, "trial_end", 1, {"complete": True}),
            Event(8, "trial_start", 2),
            said(9, 0.5, changes="angle"),
            Event(10, "trial_end", 2, {"complete": False}),
            Event(11, "run_start"),
            Event(12, "trial_start", 2),
        ]
    )
    assert [item.answers for item in found] == [{"load": 5.02}, {"load": 5.02, "angle": 0.5}, {}]


def test_a_run_without_its_end_was_interrupted() -> None:
    started, ended = Event(1, "run_start"), Event(2, "run_end", data={"state": "done"})
    assert run_state([]) == ("interrupted", "")
    assert run_state([started]) == ("interrupted", "")
    assert run_state([started, ended]) == ("done", "")
    assert run_state([started, ended, Event(3, "run_start")]) == ("interrupted", "")
    assert run_state([started, Event(3, "run_start"), Event(4, "run_end")]) == ("complete", "")


def test_trial_cut_off_ends_where_run_resumes() -> None:
    attempts = trials(
        [
            Event(10, "trial_start", 1),
            Event(30, "run_start"),
            Event(40, "trial_start", 1),
            Event(50, "trial_end", 1, {"complete": True}),
            Event(60, "trial_start", 2),
        ]
    )
    assert [
        (attempt.number, attempt.start_ns, attempt.end_ns, attempt.complete) for attempt in attempts
    ] == [
        (1, 10, 30, False),
        (1, 40, 50, True),
        (2, 60, None, False),
    ]
