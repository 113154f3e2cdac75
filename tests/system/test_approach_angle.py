"""The campaign of the approach-angle rig as a user runs it, and what goes wrong at the rig."""

from __future__ import annotations

import hashlib
import os
import re
import signal
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.commands.command import Ended, rigd
from support.commands.terminal import Terminal

from rigd.record import Event, Recording
from rigd.sdk.shipped_files import shipped_folder

ONE = ("--set", "set=clean_30", "--set", "load=5 kg", "--set", "voltage=10 V")
RATE_HZ = 9600.0


def campaign(folder: Path, changes: Mapping[str, str]) -> str:
    """Write the shipped campaign with ``changes`` to ``folder``, and return its name.

    What is wrong is not identified: that is another test's.
    """
    text = (shipped_folder("procedures") / "approach_angles.yaml").read_text("utf-8")
    for old, new in changes.items():
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times"
        text = text.replace(old, new)
    (folder / "changed.yaml").write_text(text, "utf-8")
    return "changed.yaml"


def spoilt_by(fault: str) -> dict[str, str]:
    """Return the change that spoils the rig once it is set up, 1 s before it runs."""
    prompt = (
        f"    - prompt: spoil\n      text: Spoil it.\n      choices: [{fault}]\n"
        f"      answer: {fault}\n      changes: fault\n"
        "    - step: spoilt\n      for: 1 s\n"
    )
    settle = "    - step: settle\n"
    return {settle: prompt + settle}


def run(folder: Path, procedure: str, *options: str) -> Ended:
    return rigd(
        "run", procedure, "--rig", "angle-1", "--output", "run.mcap", *options, cwd=folder
    )  # fmt: skip


def recorded(folder: Path) -> Recording:
    return Recording.open(folder / "run.mcap")


def of_kind(recording: Recording, kind: str) -> list[Mapping[str, Any]]:
    return [event.data for event in recording.events() if event.kind == kind]


def steps(recording: Recording) -> list[str]:
    return [data["name"] for data in of_kind(recording, "step")]


def closed_s(recording: Recording) -> float:
    """Return for how long the relay was commanded to be closed, in s."""
    return float((recording.read("relay")["closed_setpoint"] > 0.5).sum()) * 1e-3


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One voltage of one set: four loads, once each."""
    folder = tmp_path_factory.mktemp("campaign")
    once = campaign(folder, {"\nrepeats: 2\n": "\nrepeats: 1\n"})
    done = run(folder, once, "--set", "set=clean_30", "--set", "voltage=10 V")
    assert done.code == 0, done.err + done.out
    assert "4 of 4 trials" in done.out
    return folder


def test_prompts_follow_changes_and_answers_are_verified(whole: Path) -> None:
    recording = recorded(whole)
    answers = of_kind(recording, "answer")
    assert Counter(answer["name"] for answer in answers) == {
        "mount_angle": 1, "fit_wheel": 1, "set_voltage": 1, "put_on_weights": 4, "push_back": 4,
    }  # fmt: skip
    assert {answer["by"] for answer in answers} == {"procedure"}
    (mounting,) = (item for item in of_kind(recording, "prompt") if item["name"] == "mount_angle")
    assert "mount the shaft at 30 deg" in mounting["text"]
    weighed = [
        item for item in of_kind(recording, "answer_checked") if item["name"] == "put_on_weights"
    ]
    assert [item["answer"] for item in weighed] == [4.0, 5.0, 6.0, 8.0]
    for item in weighed:
        assert item["agreed"]
        assert item["shown"]["scale.mass"] == pytest.approx(item["answer"], rel=0.05)


def test_each_run_is_sampled_from_command_to_stop(whole: Path) -> None:
    recording = recorded(whole)
    trials = recording.info.trials
    assert [trial.number for trial in trials if trial.complete] == list(range(1, 5))
    taken = 0
    for trial in trials:
        assert trial.end_ns is not None
        relay = recording.read("relay", trial.start_ns, trial.end_ns)
        told = np.flatnonzero(relay["closed_setpoint"] > 0.5)
        command_ns, stop_ns = relay["t_ns"][told[0]], relay["t_ns"][told[-1] + 1]
        assert 0.2 < (stop_ns - command_ns) * 1e-9 < 0.7  # paper: less than 0.7 s
        rows = recording.read("daq", trial.start_ns, trial.end_ns)
        taken += len(rows)
        assert np.abs(np.diff(rows["device_time"]) - 1 / RATE_HZ).max() < 1e-9
        assert command_ns - rows["t_ns"][0] >= 140_000_000
        assert 50_000_000 <= rows["t_ns"][-1] - stop_ns < 70_000_000
        stop = int(np.searchsorted(rows["t_ns"], stop_ns))
        at_stop = rows["platform_position"][stop]
        # A block of 10 ms, its latency, and the cycle: at 2.5 m/s at most.
        assert 0.29 < at_stop < 0.3 + 2.5 * 0.05
        rest = rows[rows["t_ns"] < command_ns]
        assert abs(rest["platform_position"].mean()) < 0.01
    assert taken == recording.count("daq")  # and nothing outside of the runs


def test_info_shows_procedure_and_parameters(whole: Path) -> None:
    told = rigd("info", "run.mcap", cwd=whole)
    assert told.code == 0
    assert "4 begun" in told.out
    assert "angle = 30 deg" in told.out
    assert "calibration.yaml" in told.out


def test_the_campaign_is_identified_from_its_recording(whole: Path) -> None:
    done = rigd("identify", "run.mcap", "--json", "--no-report", cwd=whole)
    assert done.code == 0, done.err
    assert "clean_30" in done.out


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    digests = []
    for seed in ("3", "3", "4"):
        assert run(tmp_path, "approach_angles", *ONE, "--seed", seed).code == 0
        digests.append(hashlib.sha256((tmp_path / "run.mcap").read_bytes()).hexdigest())
        (tmp_path / "run.mcap").unlink()
    assert digests[0] == digests[1]
    assert digests[0] != digests[2]


def test_missing_weights_end_run_before_anything_moves(tmp_path: Path) -> None:
    forgotten = campaign(tmp_path, {"      changes: load\n": ""})
    done = run(tmp_path, forgotten, *ONE)
    assert done.code == 6
    said = " ".join(done.out.split())
    found = re.search(
        r"prompt 'put_on_weights': the answer was 5 kg, but scale.mass is (\S+) kg", said
    )
    assert found is not None
    assert float(found[1]) == pytest.approx(4.0, abs=0.15)
    assert "expected 4.75 kg to 5.25 kg" in said
    assert closed_s(recorded(tmp_path)) == 0.0


def test_person_is_asked_again_and_typed_text_recorded(
    open_terminal: Callable[..., Terminal], tmp_path: Path
) -> None:
    # Their weights do not reach the simulated rig, which holds 4 kg.
    changed = campaign(
        tmp_path,
        {"      changes: load\n": "", "0.9 * ${load}": "1 kg", "\nrepeats: 2\n": "\nrepeats: 1\n"},
    )
    terminal = open_terminal(changed, "--rig", "angle-1", "--ask", *ONE)
    for question, answer in (
        ("Which angle does it stand at?", "30 deg"),
        ("Which one is it?", "clean"),
        ("Where do they stand?", "start"),
        ("What does it weigh now?", "5.02 kg"),
        ("the answer was 5.02 kg, but scale.mass is ", None),
        ("What does it weigh now?", "4.02 kg"),
        ("What does it show?", "9 V"),
        ("9 V is outside 9.9 V .. 10.1 V", None),
        ("What does it show?", "10.05 V"),
        ("Go on?", "go on"),  # the check of the trial sees 4 kg
    ):
        terminal.expect(question)
        if answer is not None:
            terminal.type(answer)
    assert terminal.end() == 0
    recording = recorded(tmp_path)
    weights = [item for item in of_kind(recording, "answer") if item["name"] == "put_on_weights"]
    assert [(weight["answer"], weight["planned"], weight["by"]) for weight in weights] == [
        (5.02, 5.0, "operator"), (4.02, 5.0, "operator"),
    ]  # fmt: skip
    assert 0.2 < closed_s(recording) < 0.7


@pytest.mark.parametrize("where", [("clean_0", "4 kg"), ("clean_45", "8 kg")])
def test_wheel_comes_to_rest_before_its_potentiometer_ends(
    where: tuple[str, str], tmp_path: Path
) -> None:
    """Where the travel stops no drive: a dead potentiometer, or a platform that does not move."""
    changed = campaign(
        tmp_path,
        {
            "        - daq.platform_position > ${farthest}\n": "",
            "  check: ask": "  check: warn",  # the samples before the drive are not recorded
            '      until: "|wheel_stop.speed| < 2 rad/s for 0.2 s"\n': "",
            "during: [ready, drive, stopped]": "during: [drive, stopped, come to rest]",
            "  relay: 1\n": "  relay: 1\n  truth: 1\n",
            "\nrepeats: 2\n": "\nrepeats: 1\n",
        },
    )
    name, load = where
    chosen = ("--set", f"set={name}", "--set", f"load={load}", "--set", "voltage=10 V")
    done = run(tmp_path, changed, *chosen)
    assert done.code == 0, done.err + done.out
    truth = recorded(tmp_path).read("truth")
    assert abs(truth["wheel_speed"][-1]) < 0.1
    assert 30.0 < truth["wheel_angle"].max() < 50.0


def test_platform_not_pushed_back_is_not_driven(tmp_path: Path) -> None:
    done = run(tmp_path, campaign(tmp_path, {"      changes: platform\n": ""}), *ONE)
    assert done.code == 6
    said = " ".join(done.out.split())
    assert "prompt 'push_back': daq.platform_position is 0.4" in said  # at its bumper
    assert steps(recorded(tmp_path)).count("drive") == 1


def test_dead_potentiometer_is_stopped_by_longest_drive(tmp_path: Path) -> None:
    dead = campaign(tmp_path, spoilt_by("platform_pot_dead") | {"\nrepeats: 2\n": "\nrepeats: 1\n"})
    slow = ("--set", "set=clean_30", "--set", "load=5 kg", "--set", "voltage=4 V")
    done = run(tmp_path, dead, *slow)
    assert done.code == 6
    said = " ".join(done.out.split())
    assert "step 'drive' did not end within 1.5 s: daq.platform_position is" in said
    recording = recorded(tmp_path)
    assert closed_s(recording) == pytest.approx(1.5, abs=0.002)
    assert recording.read("relay")["closed_setpoint"][-1] == 0.0
    # The trial is over, the rig comes to rest, and the run ends as one that lacks a trial.
    assert steps(recording)[-3:] == ["drive", "come to rest", "open"]
    assert not any(trial.complete for trial in recording.info.trials)


def test_interlock_opens_relay_if_procedure_does_not(tmp_path: Path) -> None:
    patient = campaign(
        tmp_path,
        spoilt_by("platform_pot_dead")
        | {
            "default: 1.5 s": "default: 4 s",
            "max: 1.8 s": "max: 5 s",
            "\nrepeats: 2\n": "\nrepeats: 1\n",
        },
    )
    slow = ("--set", "set=clean_30", "--set", "load=5 kg", "--set", "voltage=4 V")
    done = run(tmp_path, patient, *slow)
    assert done.code == 4
    assert "relay_closed_too_long" in done.out
    assert 2.0 <= closed_s(recorded(tmp_path)) < 2.05


def test_scale_never_at_rest_leaves_run_undriven(tmp_path: Path) -> None:
    done = run(tmp_path, campaign(tmp_path, spoilt_by("scale_unsteady")), *ONE)
    assert done.code == 6
    assert "scale is not stable" in " ".join(done.out.split())
    assert closed_s(recorded(tmp_path)) == 0.0


def test_resumed_simulation_asks_no_set_up_again(
    open_terminal: Callable[..., Terminal], tmp_path: Path
) -> None:
    terminal = open_terminal(
        "approach_angles", "--rig", "angle-1", "--ask", "--set", "set=coated_0",
        "--set", "voltage=10 V",
    )  # fmt: skip
    for question, answer in (
        ("Which angle does it stand at?", "0 deg"),
        ("Which one is it?", "coated"),
        ("Where do they stand?", "start"),
        ("What does it weigh now?", "4 kg"),
        ("What does it show?", "10 V"),
        ("Where do they stand?", "start"),
    ):
        terminal.expect(question)
        terminal.type(answer)
    terminal.expect("Where do they stand?")  # in trial 3
    os.kill(terminal.process.pid, signal.SIGINT)
    assert terminal.end() == 5
    before = {trial.number for trial in recorded(tmp_path).info.trials if trial.complete}
    assert before == {1, 2}
    done = rigd("run", "--resume", "run.mcap", cwd=tmp_path)
    assert done.code == 0, done.err + done.out
    recording = recorded(tmp_path)
    complete = [trial.number for trial in recording.info.trials if trial.complete]
    assert sorted(complete) == list(range(1, 9))
    mounted = [event for event in recording.events() if _asks(event, "mount_angle")]
    assert [event.trial for event in mounted] == [1]  # the bench is as trial 2 left it


def _asks(event: Event, name: str) -> bool:
    return event.kind == "prompt" and event.data["name"] == name
