"""`rigd run` as a user meets it, in virtual time: recordings, dry runs, refusals, determinism."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support.commands.command import rigd

from rigd.record import Recording


def test_quick_run_records_every_cycle_and_names_next(tmp_path: Path) -> None:
    done = rigd("run", "procedures/quick.yaml", "--rig", "configs/sim_lugre.yaml", cwd=tmp_path)
    assert done.code == 0, done.err
    (path,) = (tmp_path / "runs").glob("*.mcap")
    assert str(path.relative_to(tmp_path)) in done.out
    recording = Recording.open(path)
    times = recording.read("cycle")["t_ns"]
    assert np.all(np.diff(times) == 1_000_000)
    for name in recording.streams:
        assert np.array_equal(recording.read(name)["t_ns"], times), name
    info = recording.info
    assert (info.state, info.trials_done) == ("complete", 1)
    assert set(info.attachments) >= {"procedure.yaml", "rig.yaml"}


def test_same_seed_gives_same_bytes_another_does_not(tmp_path: Path) -> None:
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


def test_dry_run_estimates_duration_within_5_percent(
    tmp_path: Path,
) -> None:
    text = Path(__file__).parents[2].joinpath("procedures/constant_current.yaml").read_text()
    assert text.count("step: 0.15 A") == 1
    (tmp_path / "few.yaml").write_text(text.replace("step: 0.15 A", "step: 0.45 A"))
    common = ("few.yaml", "--rig", "lugre-1", "--set", "floor=pvc", "--json")
    dry = rigd("run", *common, "--dry-run", "--seed", "3", cwd=tmp_path)
    assert dry.code == 0, dry.err
    assert [item.name for item in tmp_path.iterdir()] == ["few.yaml"]
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


def test_dry_run_refuses_what_would_break_limit(tmp_path: Path) -> None:
    # Without brakes the carriage coasts beyond the interlock at the end of its travel.
    text = Path(__file__).parents[2].joinpath("procedures/quick.yaml").read_text()
    reckless = text.replace("longitudinal_belt.engaged: 1", "longitudinal_belt.engaged: 0")
    assert reckless != text
    (tmp_path / "reckless.yaml").write_text(reckless)
    dry = rigd("run", "reckless.yaml", "--rig", "lugre-1", "--dry-run", cwd=tmp_path)
    assert dry.code == 3
    assert "refused" in dry.out


def test_resume_refuses_other_files_than_sweep_began_with(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    rigd("run", "quick", "--rig", "lugre-1", "--output", path, cwd=tmp_path)
    before = path.read_bytes()
    refused = rigd("run", "constant_current", "--resume", path, cwd=tmp_path)
    assert refused.code == 2
    assert "recorded with another procedure.yaml" in refused.err
    assert path.read_bytes() == before


def test_full_disk_ends_run_safe_with_readable_file(tmp_path: Path) -> None:
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
