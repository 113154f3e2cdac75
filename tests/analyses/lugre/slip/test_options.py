"""The filter of slip in a rig file: what it becomes, and every way to get it wrong."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import pytest
from support.lugre.slip import STONE, observer, with_filter

from rigd.computed.observers.driver import ObserverConfig
from rigd.config.loader import parse_rig
from rigd.engine.cycle.wiring import streams_of
from rigd.model import ConfigError
from rigd.sdk.shipped_files import shipped_folder

TEXT = (shipped_folder("configs") / "sim_lugre.yaml").read_text("utf-8")
PLANT = (shipped_folder("configs") / "plants" / "lugre.yaml").read_text("utf-8")
GOOD = observer()
FRICTION = next(line for line in GOOD.splitlines() if "friction:" in line)
NOISE = GOOD[GOOD.index("    current_noise") : GOOD.index("    unknown_push")]
SAVED = {
    "model": "lugre",
    "group": "stone",
    "parameters": {name: {"estimate": value} for name, value in STONE.items()},
    "preprocessing": {"settings": {
        "current_noise_a": 0.006, "acceleration_noise_m_s2": 0.03, "angle_count_rad": 3e-4,
        "fitted drive_gain": 0.5,
    }},
}  # fmt: skip


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "plants").mkdir()
    (tmp_path / "plants" / "lugre.yaml").write_text(PLANT, "utf-8")
    (tmp_path / "stone.json").write_text(json.dumps(SAVED), "utf-8")
    several = {"groups": [SAVED, SAVED | {"group": "pvc"}]}
    (tmp_path / "floors.json").write_text(json.dumps(several), "utf-8")
    (tmp_path / "other.json").write_text(json.dumps(SAVED | {"model": "wave"}), "utf-8")
    (tmp_path / "poor.json").write_text(json.dumps(SAVED | {"preprocessing": {}}), "utf-8")
    return tmp_path / "rig.yaml"


def config_of(observers: str, file: Path) -> ObserverConfig:
    config = parse_rig(with_filter(TEXT, observers), file).devices["slip_filter"].config
    assert isinstance(config, ObserverConfig)
    return config


def from_file(name: str, more: str = "") -> str:
    text = GOOD.replace(FRICTION, f"    model_file: {name}{more}")
    return text.replace(NOISE, "")


def test_slip_becomes_a_stream_with_units(file: Path) -> None:
    rig = parse_rig(with_filter(TEXT, GOOD), file)
    stream = next(stream for stream in streams_of(rig) if stream.name == "slip_filter")
    assert [(channel.name, channel.unit) for channel in stream.channels] == [
        ("slip", "m/s"), ("slip_sd", "m/s"), ("speed", "m/s"), ("speed_sd", "m/s"),
        ("zero", "m/s^2"), ("zero_sd", "m/s^2"), ("wheel_encoder_angle_innovation", "rad"),
        ("accelerometer_acceleration_innovation", "m/s^2"), ("nis", "1"),
    ]  # fmt: skip
    config = rig.devices["slip_filter"].config
    assert pickle.loads(pickle.dumps(config)) == config


def test_saved_model_gives_friction_constants_and_noise(file: Path) -> None:
    written, saved = config_of(GOOD, file), config_of(from_file("stone.json"), file)
    assert saved.plan.q[:6] == written.plan.q[:6]
    assert saved.plan.q[6] == 0.5
    assert saved.plan.noise[1] == 0.03
    assert saved.files() == {file.parent / "stone.json": json.dumps(SAVED)}
    assert config_of(from_file("floors.json\n    group: pvc"), file).plan.q == saved.plan.q


@pytest.mark.parametrize(
    ("old", "new", "token", "part"),
    [
        ("model: lugre", "model: lugrre", "lugrre", "did you mean 'lugre'?"),
        ("wheel_encoder.angle", "wheel_encoder.angel", "wheel_encoder.angel", "'wheel_encoder.ang"),
        ("wheel_encoder.angle", "carriage.position", "carriage.position", "is in m, expected rad"),
        ("engaged_setpoint", "engage_setpoint", "longitudinal_belt.engage_s", "unknown channel"),
        ("    current_noise: 6 mA\n", "", "", "key 'current_noise' is missing"),
        ("6 mA", "6 mV", "6 mV", "expected A"),
        ("6 mA", "0 mA", "0 mA", "above 0 A"),
        ("mu_s: 0.1205", "mu_s: 0.1", "{V_s", "must not be below mu_c"),
        ("mu_s: 0.1205, ", "", "{V_s", "key 'mu_s' is missing"),
        (FRICTION + "\n", "", "", "give 'friction', or a 'model_file'"),
        ("rolling_resistance", "roling", "roling", "has no constant 'roling'"),
        ("      mass: ${rig.moving_mass}\n", "", "rolling_resistance", "'mass' is missing"),
        ("${rig.moving_mass}", "${rig.mass}", "${rig.mass}", "the rig has no constant 'mass'"),
        ("${rig.moving_mass}", "${rig.wheel_radius}", "${rig.wheel_radius}", "expected kg"),
        ("${rig.moving_mass}", "4 m", "4 m", "expected kg"),
        ("${rig.moving_mass}", "0 kg", "mass", "mass is 0 kg, must be above 0"),
        ("u: 10 %", "u: 10 m", "u: 10 m}", "expected 1 or %"),
        ("    current_noise", "    curent: 1\n    current_noise", "curent", "unknown key 'curent'"),
    ],
)  # fmt: skip
def test_wrong_key_names_its_line(file: Path, old: str, new: str, token: str, part: str) -> None:
    assert GOOD.count(old) == 1
    text = with_filter(TEXT, GOOD.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        parse_rig(text, file)
    found = [caught.value, *caught.value.others]
    fitting = [error for error in found if part in f"{error.message} {error.hint}"]
    assert fitting, [str(error) for error in found]
    assert fitting[0].place is not None
    if token:
        at = text.index("observers:") + GOOD.replace(old, new).index(token)
        assert abs(fitting[0].place.line - (text[:at].count("\n") + 1)) <= 1


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("absent.json", "cannot read the model"),
        ("floors.json", "several models: give `group`, one of stone, pvc"),
        ("stone.json\n    group: ice", "no model ice: give `group`"),
        ("other.json", "a model wave, must be lugre"),
        ("poor.json", "does not state current_noise"),
    ],
)
def test_wrong_model_file_is_named(file: Path, name: str, part: str) -> None:
    with pytest.raises(ConfigError) as caught:
        config_of(from_file(name), file)
    assert part in str(caught.value)
    assert "rig.yaml:" in str(caught.value) or "json" in str(caught.value)
