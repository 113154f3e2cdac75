"""Maps of devices in files: shipped by name, or the lab's own beside its rig file."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from rigd.sdk import shipped_configs
from rigd_drivers import device_file
from rigd_drivers.can.cia402_servo.current import CurrentServoConfig
from rigd_drivers.modbus.servo import ServoConfig

SHIPPED = device_file.find("schneider-atv320", "modbus-servo", Path("nowhere"))
OPTIONS = {"host": "127.0.0.1", "max_speed": "100 rpm", "watchdog": "1 s"}


def options(folder: Path, name: str) -> ServoConfig:
    """Return the options of a drive as a rig file in ``folder`` gives them."""
    given = {**OPTIONS, "map": name}
    return ServoConfig.model_validate(given, context={"folder": folder})


def test_own_map_is_read_beside_the_rig_file(tmp_path: Path) -> None:
    text = SHIPPED.read_text("utf-8").replace("Schneider Altivar 320", "Our own", 1)
    (tmp_path / "ours.yaml").write_text(text.replace("title", "seen: true\ntitle", 1), "utf-8")
    described = options(tmp_path, "ours.yaml").map
    assert (described.title, described.standing) == ("Our own drive", "seen on the device")
    assert described.setpoint == options(tmp_path, "schneider-atv320").map.setpoint


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("address: 8604", "address: 86040", "speed.address: Input .* 65535, found '86040'"),
        ("scale: 1 rpm/count", "scale: 1 mm/count", "scale: '1 mm/count' is in mm/count, expected"),
        ("reaction:", "reacts:", "watchdog.reacts: unknown key"),
        ("    value: 0x0007", "    value: seven", "enable.1.value: Input should be .*'seven'"),
    ],
)
def test_wrong_own_map_names_line_and_value(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = SHIPPED.read_text("utf-8")
    assert old in text
    line = text[: text.index(old)].count("\n") + 1
    (tmp_path / "ours.yaml").write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(ValidationError, match=rf"ours\.yaml:{line}:\d+: {said}") as caught:
        options(tmp_path, "ours.yaml")
    assert "shows every key with its unit" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("ours.yaml", r"there is no file .*ours\.yaml"),
        ("schneider-atv310", "did you mean 'schneider-atv320'.* of your own ends in .yaml"),
    ],
)
def test_unknown_map_is_refused_with_what_exists(tmp_path: Path, name: str, said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        options(tmp_path, name)


def test_own_files_are_given_to_recordings(tmp_path: Path) -> None:
    text = SHIPPED.read_text("utf-8")
    (tmp_path / "ours.yaml").write_text(text, "utf-8")
    assert options(tmp_path, "ours.yaml").files() == {tmp_path / "ours.yaml": text}
    assert not options(tmp_path, "schneider-atv320").files()


def test_eds_and_profile_are_given_to_recordings(tmp_path: Path) -> None:
    profile = device_file.find("maxon-epos4", "cia402", Path("nowhere")).read_text("utf-8")
    (tmp_path / "ours.yaml").write_text(profile, "utf-8")
    sheet = (shipped_configs() / "eds" / "rigd_servo.eds").read_text("utf-8")
    (tmp_path / "ours.eds").write_text(sheet, "utf-8")
    config = CurrentServoConfig.model_validate(
        {"node": 1, "counts_per_revolution": "4096 count/rev", "current_range": "2 A",
         "profile": "ours.yaml", "eds": "ours.eds"},
        context={"folder": tmp_path},
    )  # fmt: skip
    assert config.files() == {tmp_path / "ours.eds": sheet, tmp_path / "ours.yaml": profile}
