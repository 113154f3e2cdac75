"""Bad input: a clear error with the place, the value and what to do; nothing moves or is lost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from support.commands.command import rigd

from rigd.cli.rig.check import _kind

PROCEDURES = Path(__file__).parents[2] / "procedures"


def quick(tmp_path: Path, old: str, new: str) -> Path:
    """Return a copy of quick.yaml with one thing wrong."""
    text = (PROCEDURES / "quick.yaml").read_text()
    assert old in text
    path = tmp_path / "wrong.yaml"
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("default: 1.35 A", "default: 1.35 V", ["1.35 V", "A"]),
        ("default: 1.35 A", "default: 1.35", ["1.35", "A"]),
        ("wheel_servo.current", "wheel_serva.current", ["wheel_serva", "wheel_servo"]),
        ("carriage.position", "carriage.positon", ["carriage.positon", "carriage.position"]),
        ("title:", "titel:", ["titel", "title"]),
    ],
)
def test_wrong_procedure_names_place_and_remedy(
    tmp_path: Path, old: str, new: str, words: list[str]
) -> None:
    path = quick(tmp_path, old, new)
    done = rigd("run", path.name, "--rig", "lugre-1", cwd=tmp_path)
    assert done.code == 2
    assert "wrong.yaml:" in done.err
    for word in words:
        assert word in done.err
    assert [item.name for item in tmp_path.iterdir()] == ["wrong.yaml"]


def test_setpoint_beyond_rig_limit_is_refused_before_motion(tmp_path: Path) -> None:
    done = rigd("run", "quick", "--rig", "lugre-1", "--set", "current=5 A", cwd=tmp_path)
    assert done.code == 2
    assert "5 A" in done.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["run", "missing.yaml", "--rig", "lugre-1"], 2, ["missing.yaml"]),
        (["run", "quick", "--rig", "missing.yaml"], 2, ["missing.yaml"]),
        (["run", "--rig", "lugre-1"], 2, ["no procedure is given"]),
        (["run", "quick", "--rig", "lugre-1", "--set", "current"], 2, ["NAME=VALUE"]),
        (["run", "quick", "--rig", "lugre-1", "--set", "curent=1 A"], 2, ["curent", "current"]),
        (["identify", "missing.mcap"], 7, ["missing.mcap"]),
        (["info", "missing.mcap"], 7, ["missing.mcap"]),
        (["recover", "missing.mcap"], 7, ["missing.mcap"]),
        (["export", "missing.mcap", "--to", "csv"], 7, ["missing.mcap"]),
        (["runs", "nowhere"], 7, ["nowhere"]),
        (["run", "--resume", "missing.mcap"], 7, ["missing.mcap"]),
    ],
)
def test_missing_file_is_named(
    tmp_path: Path, arguments: list[str], code: int, words: list[str]
) -> None:
    done = rigd(*arguments, cwd=tmp_path)
    assert done.code == code, done.err
    for word in words:
        assert word in done.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("content", [b"", b"\x89MCAP", b"time,value\n1,2\n", bytes(5000)])
@pytest.mark.parametrize("command", [["identify"], ["info"], ["recover"], ["run", "--resume"]])
def test_file_that_is_no_recording_is_left_untouched(
    tmp_path: Path, content: bytes, command: list[str]
) -> None:
    (tmp_path / "bad.mcap").write_bytes(content)
    done = rigd(*command, "bad.mcap", cwd=tmp_path)
    assert done.code == 7
    assert "bad.mcap" in done.err
    assert (tmp_path / "bad.mcap").read_bytes() == content


def test_error_of_truncated_recording_suggests_recover(tmp_path: Path) -> None:
    rigd("run", "quick", "--rig", "lugre-1", "--output", "run.mcap", cwd=tmp_path)
    path = tmp_path / "run.mcap"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    done = rigd("identify", "run.mcap", cwd=tmp_path)
    assert done.code == 7
    assert "rigd recover" in done.err
    assert rigd("recover", "run.mcap", cwd=tmp_path).code == 0
    assert rigd("info", "run.mcap", cwd=tmp_path).code == 0


def test_recording_without_needed_streams_names_stream(tmp_path: Path) -> None:
    text = (PROCEDURES / "constant_current.yaml").read_text()
    lean = text.replace("record: all", "record: {carriage: 1}")
    (tmp_path / "lean.yaml").write_text(lean.replace("to: 1.5 A", "to: 0.3 A"))
    made = rigd("run", "lean.yaml", "--rig", "lugre-1", "--output", "lean.mcap", cwd=tmp_path)
    if made.code == 0:
        made = rigd("identify", "lean.mcap", cwd=tmp_path)
        assert made.code == 7
    else:
        assert made.code == 2  # the check may see it before the run
    assert "accelerometer" in made.err
    assert "record" in made.err


def test_an_output_that_exists_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"precious")
    done = rigd("run", "quick", "--rig", "lugre-1", "--output", "run.mcap", cwd=tmp_path)
    assert done.code == 7
    assert (tmp_path / "run.mcap").read_bytes() == b"precious"


def test_traceback_is_shown_only_with_debug(tmp_path: Path) -> None:
    assert "Traceback" not in rigd("info", "missing.mcap", cwd=tmp_path).err
    debug = subprocess.run(
        [sys.executable, "-m", "rigd", "info", "missing.mcap", "--debug"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "Traceback" in debug.stderr


@pytest.mark.parametrize("start", ["0001-01-01", "1900-01-01", "2300-01-01", "9999-12-31"])
def test_start_that_no_recording_has_is_refused(tmp_path: Path, start: str) -> None:
    done = rigd("run", "quick", "--rig", "lugre-1", "--start", start, cwd=tmp_path)
    assert done.code == 2
    assert f"'{start}' is not between the years 1970 and 2261" in done.err
    assert not list(tmp_path.iterdir())


def test_text_that_is_no_pattern_is_refused(tmp_path: Path) -> None:
    for words in (("info", "runs/**.mcap"), ("compare", "runs/**.mcap", "b.mcap")):
        done = rigd(*words, cwd=tmp_path)
        assert done.code == 2, words
        assert "runs/**.mcap: Invalid pattern" in done.err


def test_file_in_place_of_attachments_folder_is_named(tmp_path: Path) -> None:
    rigd("run", "quick", "--rig", "lugre-1", "--output", "a.mcap", cwd=tmp_path)
    (tmp_path / "there").write_text("mine")
    done = rigd("info", "a.mcap", "--attachments", "there", cwd=tmp_path)
    assert done.code == 7
    assert "cannot make the folder there: File exists" in done.err
    assert (tmp_path / "there").read_text() == "mine"


def test_yaml_of_another_version_is_refused(tmp_path: Path) -> None:
    (tmp_path / "new.yaml").write_text("%YAML 1.3\n---\nprocedure: x\n")
    done = rigd("check", "new.yaml", cwd=tmp_path)
    assert done.code == 2
    assert "cannot be read as YAML 1.2" in done.err


def test_constant_with_blank_after_sign_is_read(tmp_path: Path) -> None:
    text = (PROCEDURES / "constant_current.yaml").read_text()
    text = text.replace("mass: ${rig.moving_mass}", "mass: '- 4000 g'")
    (tmp_path / "signed.yaml").write_text(text)
    done = rigd("check", "signed.yaml", "--rig", "lugre-1", cwd=tmp_path)
    assert done.code == 0, done.err


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("specimen: W7\nlab: x\nrig: y\ncalibration: z\n", "specimen"),
        ("\ufeffrig: x\n", "rig"),
        ("# note\n" * 700 + "rig: x\n", "rig"),
    ],
    ids=["specimen", "mark of byte order", "long comment"],
)
def test_first_key_decides_kind_of_file(tmp_path: Path, text: str, kind: str) -> None:
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
    assert _kind(str(tmp_path / "a.yaml")) == kind
