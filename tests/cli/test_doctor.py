"""`rigd doctor` of a machine alone, and of a rig that is simulated in process."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.commands.command import Ended, rigd

from rigd.model.errors import Exit


def judge(done: Ended) -> dict[str, dict[str, object]]:
    """Return its checks by name; its exit code must be what they come to."""
    checks = done.json["checks"]
    failed = [check for check in checks if check["verdict"] == "fail"]
    assert done.json["fit"] is (not failed)
    assert done.code == (Exit.BLOCKED if failed else Exit.OK)
    for check in checks:
        assert bool(check["advice"]) == (check["verdict"] != "ok"), check
    return {check["name"]: check for check in checks}


def test_the_machine_alone_is_examined_without_a_rig(tmp_path: Path) -> None:
    checks = judge(rigd("doctor", "--seconds", "1", "--json", cwd=tmp_path))
    wanted = {"system", "processors", "clock", "wall clock", "disk", "disk speed", "ring memory"}
    assert wanted | {"RT throttling", "cycle at 1000 Hz", "stalls"} <= set(checks)
    assert not list(tmp_path.iterdir())


def test_rig_simulated_in_process_is_watched_at_rest(tmp_path: Path) -> None:
    done = rigd("doctor", "--rig", "lugre-1", "--seconds", "1", "--json", cwd=tmp_path)
    checks = judge(done)
    noise = checks["wheel_servo.current"]["figures"]
    assert isinstance(noise, dict)
    assert 0.004 < noise["noise"] < 0.008  # the plant's own, 6 mA
    assert abs(noise["zero"]) < 0.002
    assert checks["carriage.position"]["verdict"] == "ok"
    assert "none needed" in str(checks["all"]["found"])


def test_doctor_output_fits_80_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    shown = rigd("doctor", "--rig", "lugre-1", "--seconds", "0.5", cwd=tmp_path).out.splitlines()
    assert max(map(len, shown)) <= 80
    assert "Nothing is armed" in " ".join(shown[:4])  # printed before it happens
    assert shown.index("machine") < shown.index("timing") < shown.index("rig lugre-1")
    assert shown[-1].startswith(("fit: ", "not fit: "))


@pytest.mark.parametrize("seconds", ["0", "nan", "long", "1e9"])
def test_doctor_refuses_durations_out_of_range(tmp_path: Path, seconds: str) -> None:
    done = rigd("doctor", "--seconds", seconds, cwd=tmp_path)
    assert done.code == Exit.BAD_INPUT
    assert "0.5 to 3600" in done.err
