"""`rigd run` as a user meets it: recordings, endings, resume, determinism."""

from __future__ import annotations

import hashlib
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.command import rigd, start

from rigd.record import Recording, run_info


def states(path: Path) -> tuple[str, list[str]]:
    """Return the ending of a recording and the names of the steps it played."""
    recording = Recording.open(path)
    steps = [str(e.data["name"]) for e in recording.events() if e.kind == "step"]
    return run_info(recording).state, steps


def test_a_quick_run_records_every_cycle_and_says_what_to_do_next(tmp_path: Path) -> None:
    done = rigd("run", "procedures/quick.yaml", "--rig", "configs/sim_lugre.yaml", cwd=tmp_path)
    assert done.code == 0, done.err
    (path,) = (tmp_path / "runs").glob("*.mcap")
    assert str(path.relative_to(tmp_path)) in done.out
    recording = Recording.open(path)
    times = recording.read("cycle")["t_ns"]
    assert np.all(np.diff(times) == 1_000_000)
    for name in recording.streams:
        assert np.array_equal(recording.read(name)["t_ns"], times), name
    info = run_info(recording)
    assert (info.state, info.trials_done) == ("complete", 1)
    assert set(info.attachments) >= {"procedure.yaml", "rig.yaml"}


def test_the_same_seed_gives_the_same_bytes_and_another_does_not(tmp_path: Path) -> None:
    digests = []
    for name, seed in (("a", 7), ("b", 7), ("c", 8)):
        path = tmp_path / f"{name}.mcap"
        done = rigd(
            "run", "quick", "--rig", "lugre-1", "--seed", str(seed), "--output", path, cwd=tmp_path
        )
        assert done.code == 0, done.err
        digests.append(hashlib.sha256(path.read_bytes()).hexdigest())
    assert digests[0] == digests[1]
    assert digests[0] != digests[2]


def test_the_dry_run_estimates_the_duration_within_5_percent_and_writes_nothing(
    tmp_path: Path,
) -> None:
    common = ("constant_current", "--rig", "lugre-1", "--set", "floor=pvc", "--json")
    dry = rigd("run", *common, "--dry-run", "--seed", "3", cwd=tmp_path)
    assert dry.code == 0, dry.err
    assert not list(tmp_path.iterdir())
    real = rigd("run", *common, "--seed", "4", cwd=tmp_path)
    assert real.code == 0, real.err
    assert dry.json["duration_s"] == pytest.approx(real.json["run_s"], rel=0.05)
    # The peaks it predicted are those of the run, and inside their limits.
    (current,) = [p for p in dry.json["peaks"] if p["channel"] == "wheel_servo.current (setpoint)"]
    assert (current["highest"], current["inside"]) == (1.5, True)
    recording = Recording.open(tmp_path / real.json["recording"])
    (position,) = [p for p in dry.json["peaks"] if p["limit_by"] == "interlock overrun_far"]
    seen = float(recording.read("carriage")["position"].max())
    assert position["highest"] == pytest.approx(seen, abs=0.02)


def test_the_dry_run_refuses_what_would_break_a_limit(tmp_path: Path) -> None:
    # Without brakes the carriage coasts beyond the interlock at the end of its travel.
    text = Path(__file__).parents[2].joinpath("procedures/quick.yaml").read_text()
    reckless = text.replace("longitudinal_belt.engaged: 1", "longitudinal_belt.engaged: 0")
    assert reckless != text
    (tmp_path / "reckless.yaml").write_text(reckless)
    dry = rigd("run", "reckless.yaml", "--rig", "lugre-1", "--dry-run", cwd=tmp_path)
    assert dry.code == 3
    assert "refused" in dry.out


@pytest.mark.parametrize(
    ("name", "told"), [("SIGINT", "Ctrl-C"), ("SIGTERM", "SIGTERM"), ("SIGHUP", "SIGHUP")]
)
def test_a_signal_stops_the_run_safe_with_its_file_finished(
    tmp_path: Path, name: str, told: str
) -> None:
    path = tmp_path / "stopped.mcap"
    run = start(
        ["run", "constant_current", "--rig", "lugre-1", "--pace", "2", "--output", path], tmp_path
    )
    run.wait_for("trial 2/10")
    run.signal(signal.Signals[name])
    ended = run.end()
    assert ended.code == 5, ended.err
    state, steps = states(path)
    assert state == "stopped"
    assert steps[-1] == "hold"  # `finish` of the procedure
    recording = Recording.open(path)
    assert recording.read("wheel_servo")["current_setpoint"][-1] == 0.0
    assert f"stopped by {told}" in ended.out

    resumed = rigd("run", "--resume", path, "--json", cwd=tmp_path)
    assert resumed.code == 0, resumed.err
    info = run_info(Recording.open(path))
    assert (info.state, info.trials_done) == ("complete", 10)
    # The first trial was complete and is not played again.
    assert [trial.number for trial in info.trials] == [1, 2, *range(2, 11)]


def test_a_second_ctrl_c_aborts_without_finish(tmp_path: Path) -> None:
    path = tmp_path / "aborted.mcap"
    run = start(
        ["run", "constant_current", "--rig", "lugre-1", "--pace", "1", "--output", path], tmp_path
    )
    run.wait_for("trial 1/10")
    run.signal(signal.SIGINT)
    run.wait_for("Ctrl-C: stopping. Again: abort")
    run.signal(signal.SIGINT)
    ended = run.end()
    assert ended.code == 5, ended.err
    state, _ = states(path)
    assert state == "aborted"
    assert Recording.open(path).read("wheel_servo")["current_setpoint"][-1] == 0.0


def test_pause_waits_between_trials_and_resume_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "paused.mcap"
    run = start(
        ["run", "constant_current", "--rig", "lugre-1", "--pace", "10", "--output", path], tmp_path
    )
    run.wait_for("trial 1/10")
    run.signal(signal.SIGUSR1)
    run.wait_for("paused; Ctrl-Z resumes")
    run.signal(signal.SIGUSR1)
    run.wait_for("trial 2/10")
    run.signal(signal.SIGINT)
    assert run.end().code == 5
    info = run_info(Recording.open(path))
    assert info.trials[0].complete


def test_a_killed_run_is_resumed_from_its_torn_file(tmp_path: Path) -> None:
    path = tmp_path / "killed.mcap"
    run = start(
        ["run", "constant_current", "--rig", "lugre-1", "--pace", "5", "--output", path], tmp_path
    )
    run.wait_for("trial 3/10")
    run.signal(signal.SIGKILL)
    run.end()
    with path.open("r+b") as stream:  # and the disk lost its last bytes too
        stream.truncate(path.stat().st_size - 100)
    path.with_name(path.name + ".journal").unlink(missing_ok=True)
    assert rigd("info", path, cwd=tmp_path).code == 0
    resumed = rigd("run", "--resume", path, cwd=tmp_path)
    assert resumed.code == 0, resumed.err
    info = run_info(Recording.open(path))
    assert (info.state, info.trials_done) == ("complete", 10)
    times = Recording.open(path).read("carriage")["t_ns"]
    assert np.all(np.diff(times) > 0)


def test_resume_refuses_other_files_than_the_sweep_began_with(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    rigd("run", "quick", "--rig", "lugre-1", "--output", path, cwd=tmp_path)
    before = path.read_bytes()
    refused = rigd("run", "constant_current", "--resume", path, cwd=tmp_path)
    assert refused.code == 2
    assert "recorded with another procedure.yaml" in refused.err
    assert path.read_bytes() == before


def test_a_full_disk_ends_the_run_safe_with_a_readable_file(tmp_path: Path) -> None:
    # The kernel refuses to let any file grow beyond 4 MB: what a full disk looks like.
    script = (
        "import resource, signal, sys\n"
        "from rigd.cli.main import main\n"
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4_000_000, 4_000_000))\n"
        "sys.exit(main(['run', 'constant_current', '--rig', 'lugre-1', '--output', 'full.mcap']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 7, done.stderr
    assert "full.mcap" in done.stderr
    assert "Traceback" not in done.stderr
    recovered = rigd("recover", "full.mcap", cwd=tmp_path)
    assert recovered.code == 0, recovered.err
    recording = Recording.open(tmp_path / "full.mcap")
    assert recording.count("carriage") > 500
