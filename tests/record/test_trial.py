"""Trials in a notebook: found by number, shown as a table, their samples as arrays."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import rigd
from rigd.model import RecordingError, Stream
from rigd.record import Recording, RecordingWriter

Create = Callable[..., RecordingWriter]
MakeRows = Callable[..., NDArray[np.void]]
MS = 1_000_000


@pytest.fixture
def moved(rows: MakeRows, servo: Stream) -> NDArray[np.void]:
    return rows(servo, 4_000)


@pytest.fixture
def recording(create: Create, moved: NDArray[np.void], start_ns: int, tmp_path: Path) -> Recording:
    """Trial 1, trial 2 broken off, trial 2 again, trial 3 that the file ends within."""
    with create() as writer:
        writer.write("wheel_servo", moved)
        writer.event(start_ns, "run_start")
        attempts = ((1, 500, 1000, True), (2, 1000, 1200, False), (2, 2000, 3000, True))
        for number, begin, end, complete in attempts:
            at = start_ns + begin * MS
            data = {"repeat": 1, "parameters": {"current": 0.1 * number, "floor": "pvc"}}
            writer.event(at, "trial_start", number, {**data, "units": {"current": "mA"}})
            writer.event(at + 10 * MS, "step", number, {"name": "settle"})
            writer.event(at + 100 * MS, "step", number, {"name": "drive"})
            reason = "all steps played" if complete else "stopped"
            ended = {"complete": complete, "reason": reason}
            writer.event(start_ns + end * MS, "trial_end", number, ended)
        writer.event(start_ns + 3500 * MS, "trial_start", 3, {"parameters": {}})
    return rigd.open(str(tmp_path / "run.mcap"))


def test_the_last_complete_attempt_is_the_trial(recording: Recording, start_ns: int) -> None:
    trial = recording.trial(2)
    assert (trial.start_ns - start_ns, trial.duration_s) == (2000 * MS, 1.0)
    assert trial.complete
    assert [step.name for step in trial.steps] == ["settle", "drive"]
    assert [event.kind for event in trial.events] == ["trial_start", "step", "step", "trial_end"]
    assert len(recording.trials) == 4
    assert not recording.trials[1].complete


def test_samples_of_trial_have_their_time_and_step(
    recording: Recording, moved: NDArray[np.void]
) -> None:
    samples = recording.trial(2)["wheel_servo"]
    assert len(samples) == 1000
    np.testing.assert_array_equal(samples["current"], moved["current"][2000:3000])
    np.testing.assert_allclose(samples["trial_time"], np.arange(1000) * 1e-3, atol=1e-12)
    np.testing.assert_allclose(samples["time"], 2 + np.arange(1000) * 1e-3, atol=1e-9)
    assert samples["step"].tolist() == [""] * 10 + ["settle"] * 90 + ["drive"] * 900
    assert samples.units["current"] == "A"
    rows = samples.to_numpy()
    assert (rows["step"][99], rows["step"][100]) == ("settle", "drive")
    np.testing.assert_array_equal(rows["status"], moved["status"][2000:3000])


def test_trial_without_end_lasts_to_last_row(recording: Recording) -> None:
    trial = recording.trial(3)
    assert len(trial["wheel_servo"]) == 500
    assert "incomplete: no end" in repr(trial)


def test_samples_and_trials_become_data_frames(
    recording: Recording, moved: NDArray[np.void]
) -> None:
    frame = recording.trial(1)["wheel_servo"].to_pandas()
    assert frame["current"].tolist() == moved["current"][500:1000].tolist()
    assert frame.groupby("step", sort=False).size().to_dict() == {
        "": 10,
        "settle": 90,
        "drive": 400,
    }
    table = recording.trials.to_pandas()
    assert table["number"].tolist() == [1, 2, 2, 3]
    assert table["complete"].tolist() == [True, False, True, False]
    assert table["start"].tolist() == [0.5, 1.0, 2.0, 3.5]
    assert table["end"].fillna(-1).tolist() == pytest.approx([1.0, 1.2, 3.0, -1])
    assert table["floor"].tolist() == ["pvc", "pvc", "pvc", ""]
    # In SI, with any unit in the procedure.
    assert table["current"].fillna(-1).tolist() == [0.1, 0.2, 0.2, -1]
    assert table.attrs["units"]["current"] == "A"


def test_a_whole_stream_names_trial_and_step(recording: Recording) -> None:
    samples = recording["wheel_servo"]
    numbers, counts = np.unique(samples["trial"], return_counts=True)
    assert dict(zip(numbers.tolist(), counts.tolist(), strict=True)) == {
        -1: 1800,
        1: 500,
        2: 1200,
        3: 500,
    }
    assert (np.isnan(samples["trial_time"]) == (samples["trial"] == -1)).all()


def test_notebook_representation_is_short(recording: Recording) -> None:
    assert repr(recording).endswith("run.mcap: 4.0 s of wheel_servo, force>")
    shown = repr(recording.trials).splitlines()
    assert shown[0] == "4 trials"
    assert shown[1] == "<trial 1: current=0.1, floor=pvc; 0.5 s, complete>"
    assert "current [A]" in repr(recording.trial(1)["wheel_servo"])
    html = recording.trials._repr_html_()
    assert html.count("<tr>") == 5
    assert "<th>current [A]</th>" in html


def test_a_trial_that_is_not_there_is_named(recording: Recording) -> None:
    with pytest.raises(RecordingError, match=r"no trial 9\s+It has \[1, 2, 3\]"):
        recording.trial(9)
    with pytest.raises(KeyError, match="no column 'curent'"):
        recording.trial(1)["wheel_servo"]["curent"]


def test_importing_rigd_loads_neither_numpy_nor_mcap() -> None:
    code = "import sys, rigd; print(sorted({'numpy', 'mcap', 'pandas'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_step_ends_where_prompt_begins(create: Create, start_ns: int, tmp_path: Path) -> None:
    played = [("trial_start", ""), ("step", "drive"), ("prompt", "turn"), ("answer", "turn"),
              ("step", "next"), ("trial_end", "")]  # fmt: skip
    with create() as writer:
        for second, (kind, name) in enumerate(played):
            writer.event(start_ns + second * 10**9, kind, 1, {"name": name} if name else {})
    found = Recording.open(tmp_path / "run.mcap").steps
    spans = [(item.name, item.start_ns - start_ns, (item.end_ns or 0) - start_ns) for item in found]
    assert spans == [
        ("drive", 10**9, 2 * 10**9), ("next", 4 * 10**9, 5 * 10**9),
    ]  # fmt: skip
