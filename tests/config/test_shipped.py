"""Finding files by path and by name."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rigd.config.shipped_files import find_file, location
from rigd.model import ConfigError
from rigd.sdk.shipped_files import shipped_folder


def test_rig_is_found_by_name_and_path() -> None:
    shipped = shipped_folder("configs") / "sim_lugre.yaml"
    assert find_file("lugre-1", "configs").resolve() == shipped
    assert find_file("sim_lugre", "configs").resolve() == shipped
    assert find_file("configs/sim_lugre.yaml", "configs").resolve() == shipped


def test_shipped_path_works_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = find_file("procedures/quick.yaml", "procedures")
    assert found == shipped_folder("procedures") / "quick.yaml"


@pytest.mark.parametrize(
    "path",
    ["./quick.yaml", "quick.yaml", "./procedures/quick.yaml", "../procedures/quick.yaml",
     "foo/quick.yaml", "foo/quick", "./quick"],
)  # fmt: skip
def test_path_without_file_finds_no_shipped_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(ConfigError, match=rf"file '{path}' does not exist below .*here") as told:
        find_file(path, "procedures")
    assert told.value.hint == "to use the shipped procedure, give its name: quick"


def test_missing_file_in_own_folder_finds_none_shipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("procedures").mkdir()
    with pytest.raises(ConfigError, match=r"'procedures/quick\.yaml'"):
        find_file("procedures/quick.yaml", "procedures")
    Path("configs").mkdir()
    with pytest.raises(ConfigError, match=r"'configs/wire_lugre\.yaml'") as told:
        find_file("configs/wire_lugre.yaml", "configs")
    assert told.value.hint == "to use the shipped rig, give its name: wire_lugre"


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffrig: lugre-1\n",
        'rig: "lugre-1"\n',
        "rig: 'lugre-1'\n",
        "# note\n" * 700 + "rig: lugre-1\n",
    ],
    ids=["mark of byte order", "double quotes", "single quotes", "long comment"],
)
def test_own_file_is_found_however_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "configs" / "mine.yaml"
    own.parent.mkdir()
    own.write_text(text, encoding="utf-8")
    assert find_file("lugre-1", "configs").resolve() == own


def test_own_file_precedes_the_shipped_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "configs" / "mine.yaml"
    own.parent.mkdir()
    own.write_text("# mine\nrig: lugre-1\n")
    assert find_file("lugre-1", "configs").resolve() == own


def test_pipe_in_the_folder_delays_no_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To open it waits for its writer: each command that takes a name would hang."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "bench.yaml").write_text("rig: bench-7\n")
    assert find_file("bench-7", "configs") == Path("bench.yaml")


def test_name_in_two_files_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        (tmp_path / f"{name}.yaml").write_text("rig: twin\n")
    with pytest.raises(ConfigError, match=r"could be a\.yaml and b\.yaml"):
        find_file("twin", "configs")


def test_unknown_name_gives_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean 'quick'"):
        find_file("quik", "procedures")
    with pytest.raises(ConfigError, match=r"rig 'configs/none\.yaml'"):
        find_file("configs/none.yaml", "configs")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("lugre-1", "./coated.yaml, instead of the shipped rig"),
        ("sim_approach_angle", "./sim_approach_angle.yaml, instead of the shipped rig"),
        ("bench-7", "./configs/bench.yaml"),
        ("configs/bench.yaml", "configs/bench.yaml"),
        ("coated.yaml", "coated.yaml"),
        ("wire-1", "shipped"),
    ],
)
def test_location_of_a_rig_file_is_reported(
    given: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "configs").mkdir()
    for file, name in {
        "coated.yaml": "lugre-1", "sim_approach_angle.yaml": "mine", "configs/bench.yaml": "bench-7"
    }.items():  # fmt: skip
        (tmp_path / file).write_text(f"rig: {name}\n")
    assert location(given, find_file(given, "configs"), "configs") == told


def test_documented_path_elsewhere_is_reported_as_shipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    given = "configs/wire_lugre.yaml"
    assert location(given, find_file(given, "configs"), "configs") == "shipped"
