"""What a run in virtual time draws belongs to its trials: resumed or apart, they are the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rigd.config.loader import load_rig
from rigd.daemon.execute import RunRequest, perform
from rigd.daemon.resume import read_resume_point
from rigd.engine.play.control import Control
from rigd.engine.run.answers import OwnAnswers
from rigd.engine.run.draws import trial_seeds
from rigd.engine.run.result import Progress
from rigd.model.rows import TIME_FIELD
from rigd.model.severity import Severity
from rigd.procedure.compile import compile_procedure
from rigd.procedure.loader import load_procedure
from rigd.procedure.program import Answer, Prompt
from rigd.record import Recording

#: Rig, procedure and two or more of its trials, of each kind of simulated rig.
CAMPAIGNS = {
    "lugre": ("lugre-1", "constant_current", {"floor": "pvc"}),
    "angle": ("angle-1", "approach_angles", {"set": "clean_0", "voltage": "10 V"}),
    "robot": ("articulated-1", "straight_speeds", {"speed": "100 rad/s", "hold_until": "1 s"}),
}


def request(campaign: str, path: Path, **changed: str) -> RunRequest:
    rig_name, name, values = CAMPAIGNS[campaign]
    overrides = values | changed
    rig, source = load_rig(rig_name), load_procedure(name)
    procedure = compile_procedure(source, rig, overrides)
    some = replace(procedure, trials=procedure.trials[:3])
    return RunRequest(some, source.file.text, rig, 1, output=path, overrides=overrides)


def during(number: int, act: Callable[[], None]) -> Callable[[Progress], None]:
    def watch(progress: Progress) -> None:
        if progress.trial is not None and progress.trial.number == number and progress.step:
            act()

    return watch


def trial_rows(path: Path, number: int) -> dict[str, NDArray[np.void]]:
    """Return all rows of the whole trial of this number, timed from its start."""
    recording = Recording.open(path)
    trial = next(item for item in recording.trials if item.number == number and item.complete)
    streams = {}
    for name in recording.streams:
        rows = recording.read(name, trial.start_ns, trial.end_ns).copy()
        for field in rows.dtype.names or ():
            if field == TIME_FIELD:
                rows[field] -= trial.start_ns
        streams[name] = rows
    return streams


@pytest.mark.parametrize("campaign", CAMPAIGNS)
def test_resumed_run_equals_uninterrupted_one(campaign: str, tmp_path: Path) -> None:
    whole, broken = tmp_path / "whole.mcap", tmp_path / "broken.mcap"
    assert perform(request(campaign, whole), Control()).result.exit_code == 0
    control = Control()
    stop = during(2, lambda: control.request(Severity.STOP, "stopped by the test"))
    asked = request(campaign, broken)
    assert perform(asked, control, watch=stop).result.exit_code != 0
    point = read_resume_point(broken)
    assert point.done == {1}
    resumed = perform(replace(asked, resume=point, output=None), Control())
    assert resumed.result.exit_code == 0, resumed.result.reason
    assert resumed.result.trials_done == len(asked.procedure.trials)
    numbers = [trial.number for trial in Recording.open(broken).trials]
    assert numbers == [1, 2, *(trial.number for trial in asked.procedure.trials[1:])]
    for trial in asked.procedure.trials:
        expected, found = trial_rows(whole, trial.number), trial_rows(broken, trial.number)
        for name, rows in expected.items():
            assert rows.tobytes() == found[name].tobytes(), (trial.number, name)


def test_parts_recorded_apart_share_no_noise(tmp_path: Path) -> None:
    noise = {}
    for name in ("clean_0", "coated_0"):
        asked = request("angle", tmp_path / f"{name}.mcap", set=name, load="8 kg")
        assert perform(asked, Control()).result.exit_code == 0
        noise[name] = trial_rows(asked.output or tmp_path, 1)["daq"]["platform_position_raw"][:500]
    same = np.mean(noise["clean_0"] == noise["coated_0"])
    assert same < 0.5  # a bit of the card is as wide as the noise: 100 % where it is shared


def test_part_recorded_apart_draws_what_whole_does() -> None:
    def seeds(**overrides: str) -> dict[tuple[object, ...], int]:
        procedure = compile_procedure(
            load_procedure("approach_angles"), load_rig("angle-1"), overrides
        )
        found = trial_seeds(1, "angle-1", procedure.name, procedure.trials)
        keys = ("set", "load", "voltage")
        return {
            (*(trial.parameters[key] for key in keys), trial.repeat): found[trial.number]
            for trial in procedure.trials
        }

    whole, part = seeds(), seeds(set="clean_30", voltage="7 V")
    assert len(set(whole.values())) == 200
    assert len(part) == 8
    assert part.items() <= whole.items()


def test_answers_of_person_are_given_again(tmp_path: Path) -> None:
    asked = request("angle", tmp_path / "whole.mcap")
    perform(asked, Control(), answers=Heavy())
    control, broken = Control(), replace(asked, output=tmp_path / "broken.mcap")
    stop = during(2, lambda: control.request(Severity.STOP, "stopped by the test"))
    perform(broken, control, answers=Heavy(), watch=stop)
    point = read_resume_point(tmp_path / "broken.mcap")
    assert perform(replace(broken, resume=point), Control()).result.exit_code == 0
    whole, resumed = (trial_rows(tmp_path / f"{name}.mcap", 2) for name in ("whole", "broken"))
    assert whole["daq"].tobytes() == resumed["daq"].tobytes()
    for name in ("whole", "broken"):
        trials = Recording.open(tmp_path / f"{name}.mcap").info.trials
        assert trials[-1].answers["load"] == 5.0
        assert trials[-2].answers == {
            "angle": 0.0, "wheel": "clean", "platform": "start", "load": 4.1, "voltage": 10.0
        }  # fmt: skip
    assert np.median(resumed["scale"]["mass"]) == pytest.approx(4.1, abs=0.1)


class Heavy(OwnAnswers):
    """Answers as the procedure does, but first loads the wheel with 4.1 kg, at a second attempt."""

    by = "operator"
    asks_again = True

    def __init__(self) -> None:
        self._answers: list[Answer] = [15.0, 4.1]

    def answer(self, prompt: Prompt, objection: str = "") -> Answer:
        if prompt.name == "put_on_weights" and self._answers:
            return self._answers.pop(0)
        return super().answer(prompt, objection)
