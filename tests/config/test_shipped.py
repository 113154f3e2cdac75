"""Finding files by path and by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from rigd.config.shipped import find_file, whence
from rigd.model import ConfigError
from rigd.sdk.shipped import shipped_folder


def test_by_name_in_the_file_and_by_file_name() -> None:
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
def test_a_path_without_a_file_means_no_shipped_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(ConfigError, match=rf"there is no file '{path}' below .*here") as told:
        find_file(path, "procedures")
    assert told.value.hint == "the shipped procedure is meant by its name: quick"


def test_a_missing_file_of_an_own_folder_means_no_shipped_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("procedures").mkdir()
    with pytest.raises(ConfigError, match=r"there is no file 'procedures/quick\.yaml'"):
        find_file("procedures/quick.yaml", "procedures")
    Path("configs").mkdir()
    with pytest.raises(ConfigError, match=r"there is no file 'configs/wire_lugre\.yaml'") as told:
        find_file("configs/wire_lugre.yaml", "configs")
    assert told.value.hint == "the shipped rig is meant by its name: wire_lugre"


def test_own_file_goes_before_the_shipped_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    own = tmp_path / "configs" / "mine.yaml"
    own.parent.mkdir()
    own.write_text("# mine\nrig: lugre-1\n")
    assert find_file("lugre-1", "configs").resolve() == own


def test_name_in_two_files_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        (tmp_path / f"{name}.yaml").write_text("rig: twin\n")
    with pytest.raises(ConfigError, match=r"could be a\.yaml and b\.yaml"):
        find_file("twin", "configs")


def test_unknown_name_gives_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean 'quick'"):
        find_file("quik", "procedures")
    with pytest.raises(ConfigError, match=r"there is no rig 'configs/none\.yaml'"):
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
def test_where_a_rig_was_taken_from_is_said(
    given: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "configs").mkdir()
    for file, name in {
        "coated.yaml": "lugre-1", "sim_approach_angle.yaml": "mine", "configs/bench.yaml": "bench-7"
    }.items():  # fmt: skip
        (tmp_path / file).write_text(f"rig: {name}\n")
    assert whence(given, find_file(given, "configs"), "configs") == told


def test_a_documented_path_elsewhere_is_said_to_be_shipped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    given = "configs/wire_lugre.yaml"
    assert whence(given, find_file(given, "configs"), "configs") == "shipped"
