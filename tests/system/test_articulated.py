"""Both stages of the articulated robot as a user runs them, and what their recordings hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from support.commands.command import Ended, rigd

import rigd as library

RIG = ("--rig", "articulated-1")


def run(folder: Path, procedure: str, *options: str) -> Ended:
    return rigd("run", procedure, *RIG, "--output", "run.mcap", *options, cwd=folder)


def radii(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """Return half of the extent along x and along y of a circle that is driven many times."""
    return float(np.ptp(x)) / 2, float(np.ptp(y)) / 2


@pytest.fixture(scope="module")
def straight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One speed as shipped: ramped, and stepped."""
    folder = tmp_path_factory.mktemp("straight")
    done = run(folder, "straight_speeds", "--set", "speed=250 rad/s")
    assert done.code == 0, done.err + done.out
    assert "2 of 2 trials" in done.out
    return folder


def test_straight_runs_go_as_far_as_documented(straight: Path) -> None:
    recording = library.open(straight / "run.mcap")
    for number, name, travel in ((1, "ramp up", 1.08794), (2, "step up", 1.17021)):
        samples = recording.trial(number)["truth_front"]
        driven = samples["step"] == name
        along = np.cos(samples["heading"][driven][0])
        gone = np.ptp(samples["x"][driven]) / along
        assert gone == pytest.approx(travel, abs=3e-3)  # a row in 10 ms, at 0.4 m/s
        assert samples["front_right_sliding"][driven].any() == (number == 2)


def test_markers_come_beside_the_cycle(straight: Path) -> None:
    recording = library.open(straight / "run.mcap")
    motor, marker = (recording.trial(1)[name] for name in ("right_motor", "front_marker"))
    truth = recording.trial(1)["truth_front"]
    assert np.diff(motor["t_ns"]) == pytest.approx(1e6)
    paces = np.unique(np.round(np.diff(marker["t_ns"]) / 40e6, 6) % 1.0)
    assert paces.tolist() == [0.0]
    # What came is where the module was 20 ms before, with 2 mm of noise; a marker may be exchanged.
    off = marker["x"] - np.interp(marker["time"] - 0.020, truth["time"], truth["x"])
    assert np.median(np.abs(off)) == pytest.approx(0.6745 * 2e-3, rel=0.4)
    unaware = marker["x"] - np.interp(marker["time"], truth["time"], truth["x"])
    assert np.median(unaware) < np.median(off) - 3e-3


def test_same_seed_gives_the_same_bytes(straight: Path, tmp_path: Path) -> None:
    first = (straight / "run.mcap").read_bytes()
    assert run(tmp_path, "straight_speeds", "--set", "speed=250 rad/s").code == 0
    assert (tmp_path / "run.mcap").read_bytes() == first


def test_dry_run_and_report_know_the_robot(straight: Path) -> None:
    dry = rigd(
        "run", "straight_speeds", *RIG, "--dry-run", "--set", "speed=500 rad/s", cwd=straight
    )
    assert dry.code == 0, dry.err + dry.out
    assert "fit to run" in dry.out
    report = rigd("report", "run.mcap", "--output", "page.html", cwd=straight)
    assert report.code == 0, report.err
    assert "front_marker" in (straight / "page.html").read_text("utf-8")


def test_recording_names_contact_law_and_loads(straight: Path) -> None:
    done = rigd("info", "run.mcap", "--attachments", "kept", cwd=straight)
    assert done.code == 0, done.err
    rig = (straight / "kept" / "rig.yaml").read_text("utf-8")
    assert "law: paper" in rig
    assert "loads: equal" in rig
    assert (straight / "kept" / "plants" / "articulated.yaml").is_file()


def test_circles_have_the_radius_of_the_paper(tmp_path: Path) -> None:
    done = run(tmp_path, "circles")
    assert done.code == 0, done.err + done.out
    assert "5 of 5 trials" in done.out
    recording = library.open(tmp_path / "run.mcap")
    for number in range(1, 5):
        trial = recording.trial(number)
        truth, marker = trial["truth_front"], trial["front_marker"]
        driven = (truth["step"] == "circle") & (truth["trial_time"] > 12.0)
        assert radii(truth["x"][driven], truth["y"][driven]) == pytest.approx(
            (0.46601, 0.46601), abs=1e-4
        )
        # The scale of the camera errs by 1 % along y; exchanged markers lie far off.
        then = np.interp(marker["time"] - 0.020, truth["time"], truth["y"])
        right = np.abs(marker["y"] - then) < 0.02
        slope = np.polyfit(then[right], marker["y"][right], 1)[0]
        assert slope == pytest.approx(1.01, abs=1e-3)
        turned = np.ptp(truth["heading"][driven]) * np.sign(truth["heading"][driven][-1])
        assert turned > 0.0 if number < 3 else turned < 0.0
    fast = recording.trial(5)["truth_front"]
    assert fast["rear_left_sliding"][-200:].any() or fast["front_right_sliding"][-200:].any()


def test_chain_with_driven_ends_stays_stretched(tmp_path: Path) -> None:
    """Its last module pulls back; the hinges join what the parameter file says they join."""
    speeds = {"right": 220, "left": 150, "rear_right": 200, "rear_left": 135}
    options = [f"--set={name}={value} rad/s" for name, value in speeds.items()]
    options += ["--set=ramp_time=0.3 s", "--set=duration=5 s"]
    chain = ("chain_manoeuvres", "--rig", "articulated-3", *options)
    done = rigd("run", *chain, "--output", "run.mcap", cwd=tmp_path)
    assert done.code == 0, done.err + done.out
    trial = library.open(tmp_path / "run.mcap").trial(1)
    first, middle, last = (trial[f"truth_{name}"] for name in ("first", "middle", "last"))
    for ahead, behind, lengths in ((first, middle, (0.2, 0.18)), (middle, last, (0.18, 0.2))):
        for axis, ratio in (("x", np.cos), ("y", np.sin)):
            hinge = ahead[axis] - lengths[0] * ratio(ahead["heading"])
            other = behind[axis] + lengths[1] * ratio(behind["heading"])
            assert hinge == pytest.approx(other, abs=1e-12)
        assert np.radians(5.0) < np.max(np.abs(behind["hinge_angle"])) < np.radians(60.0)
    slid = [data["front_right_sliding"].any() for data in (first, middle, last)]
    assert slid == [False, True, False]
    for name in ("first", "middle", "last"):
        assert len(trial[f"marker_{name}"]["x"]) > 0.9 * 25.0 * np.ptp(first["time"])
    dry = rigd("run", *chain, "--dry-run", cwd=tmp_path)
    assert dry.code == 0, dry.err + dry.out
    assert "fit to run" in dry.out
