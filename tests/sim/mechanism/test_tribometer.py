"""The tribometer at the wire: an inverter on Modbus RTU and devices that send lines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ruamel.yaml import YAML
from support import wire
from support.commands.command import rigd
from support.wire import TRIBOMETER, WireRig, wire_rig

from rigd.cli.plugins.new_rig.at_wire import NotServed, at_wire
from rigd.cli.plugins.new_rig.folder import write_rig
from rigd.cli.plugins.new_rig.yaml_text import yaml_text
from rigd.config.loader import load_rig
from rigd.model.channels import STALE
from rigd.model.errors import ConfigError
from rigd.record import Recording
from rigd.sdk.shipped_files import shipped_folder

CONFIGS = shipped_folder("configs")
PROCEDURE = shipped_folder("procedures") / "sliding_speeds.yaml"


def shipped(name: str) -> dict[str, Any]:
    loaded: dict[str, Any] = YAML(typ="safe").load((CONFIGS / name).read_text("utf-8"))
    return loaded


def description() -> dict[str, Any]:
    """Return the shipped tribometer as `rigd new rig --from` takes it."""
    real, sim = shipped("wire_tribometer.yaml"), shipped("sim_tribometer.yaml")
    devices = {
        name: {**device, **sim["devices"][name]["options"]}
        for name, device in real["devices"].items()
    }
    devices["thermometer"]["options"]["ask"] = "T?\\r"
    shared = {key: real[key] for key in ("title", "cycle", "derived", "interlocks", "constants")}
    first = {"setpoint": "spindle.speed", "values": ["600 rpm"], "for": "2 s"}
    mechanism = shipped("plants/tribometer.yaml")
    return {**shared, "mechanism": mechanism, "devices": devices, "first": first}


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    folder = tmp_path_factory.mktemp("tribometer")
    (folder / "sim_tribometer.yaml").write_text(
        (CONFIGS / "sim_tribometer.yaml").read_text("utf-8").replace(
            "parameters: plants", f"parameters: {CONFIGS}/plants"
        )
    )  # fmt: skip
    text = PROCEDURE.read_text("utf-8")
    for old, new in {
        "[300 rpm, 600 rpm, 1200 rpm]": "[600 rpm]",
        "repeats: 3": "repeats: 1",
        "for: 5 s": "for: 2.5 s",
        "last 3 s": "last 1 s",
    }.items():
        assert old in text
        text = text.replace(old, new)
    (folder / "short.yaml").write_text(text.partition("accept:")[0])  # one shows no repeatability
    with wire_rig(folder, "tribometer-test", shipped=TRIBOMETER) as served:
        yield served


def test_procedure_measures_friction_over_modbus_and_lines(rig: WireRig) -> None:
    folder = rig.rig.parent
    done = rigd("run", "short.yaml", "--rig", rig.rig, "--output", "wire.mcap", cwd=folder)
    assert done.code == 0, done.out + done.err
    recording = Recording.open(folder / "wire.mcap")
    speed, force = recording.read("spindle")["speed"], recording.read("cell")["force"]
    heat = recording.read("thermometer")["temperature"]
    turns = 600 / 60 * 2 * np.pi
    assert np.max(speed) == pytest.approx(turns, rel=0.02)
    held = np.abs(force)
    assert np.median(held[held > 0.6]) == pytest.approx(0.124 * 9.81, rel=0.05)  # the plant's law
    assert np.median(heat) == pytest.approx(293.15, abs=2.0)
    assert abs(speed[-1]) < 5 / 60 * 2 * np.pi  # the procedure waits until it stands
    assert not np.any(recording.read("spindle")["status"] & STALE)  # it has a pace of its own
    drive = rig.parts()["spindle"]
    assert not drive["enabled"]
    assert drive["trips"] >= 1  # the proof of its watchdog, before anything moved


def test_blocked_motor_ends_run_by_interlock(rig: WireRig) -> None:
    folder = rig.rig.parent
    rig.ask(do="fault", part="spindle", fault="blocked")
    done = rigd("run", "short.yaml", "--rig", rig.rig, "--output", "b.mcap", cwd=folder)
    rig.ask(do="clear", part="spindle", fault="blocked")
    assert done.code == 4, done.out + done.err
    assert "spindle_follows" in done.out + done.err
    assert not rig.parts()["spindle"]["enabled"]


def test_rig_that_nothing_serves_names_rigd_sim(rig: WireRig, tmp_path: Path) -> None:
    (tmp_path / "sim_tribometer.yaml").write_text(
        (rig.rig.parent / "sim_tribometer.yaml").read_text("utf-8")
    )
    unserved = wire.write_rig(tmp_path, "not-served", shipped=TRIBOMETER)
    done = rigd("read", "--rig", unserved.rig, "--once", cwd=tmp_path)
    assert done.code == 3
    assert "nothing serves the simulated devices of not-served" in done.err
    assert "first: rigd sim not-served" in done.err


def test_new_rig_writes_the_same_rig_at_wire(tmp_path: Path) -> None:
    write_rig("mine", yaml_text(description()), Path("rig.yaml"), tmp_path / "mine")
    written: Mapping[str, Any] = YAML(typ="safe").load(
        (tmp_path / "mine" / "wire.yaml").read_text("utf-8")
    )
    simulated, known = written["simulation"], shipped("wire_tribometer.yaml")["simulation"]
    assert simulated["modbus"] == known["modbus"]
    assert simulated["lines"]["thermometer"]["ask"] == known["lines"]["thermometer"]["ask"]
    for name, device in known["lines"].items():
        assert simulated["lines"][name]["values"] == device["values"]
    assert written["devices"]["cell"]["options"]["port"] == "/tmp/rigd-mine/cell"
    rig = load_rig(tmp_path / "mine" / "wire.yaml")
    assert [item.stale_after_s for item in rig.interlocks] == [1.0, 3.0, 1.0]


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"pattern": r"(?P<force>-?\d+\.\d) kN"}, "{force:.1f} kN"),
        ({"pattern": r"N\+(?P<force>[-+]\d+,\d{2})", "decimal": "comma"}, "N+{force:+.2f}"),
        ({"columns": ["-", "force"], "separator": ";"}, "0;{force:.3f}"),
        ({"columns": ["force"]}, "{force:.3f}"),
    ],
)
def test_simulated_line_is_what_driver_reads(options: dict[str, Any], line: str) -> None:
    described = description()
    cell = described["devices"]["cell"]
    kept = {key: value for key, value in cell["options"].items() if key != "pattern"}
    cell["options"] = {**kept, **options}
    real = {**described, "devices": described["devices"], "sibling": "sim.yaml"}
    made = at_wire("mine", real, described["devices"])
    assert made["simulation"]["lines"]["cell"]["answer"] == line


@pytest.mark.parametrize(
    ("device", "changes", "words"),
    [
        ("cell", {"options": {"pattern": r"(?:A|B) (?P<force>\d+)", "channels": {"force": "N"}}},
         "no line can be made from the pattern of cell"),
        ("cell", {"channels": {}}, "no sensor of the mechanism stands for cell.force"),
        ("cell", {"driver": "scpi"}, "nothing simulates cell, of scpi; only cia402-rotary, lines"),
        ("spindle", {"options": {"map": "my_drive.yaml"}}, "with the maps delta-asda-b, schneider"),
        ("spindle", {"options": {"map": "delta-asda-b", "travel": "1 mm/rev"}}, "moves an axis"),
    ],
)  # fmt: skip
def test_device_that_nothing_simulates_is_named(
    device: str, changes: dict[str, Any], words: str
) -> None:
    described = description()
    described["devices"][device].update(changes)
    with pytest.raises(NotServed, match=words):
        at_wire("mine", {**described, "sibling": "sim.yaml"}, described["devices"])


def test_new_rig_tells_why_no_rig_at_wire(tmp_path: Path) -> None:
    described = description()
    described["devices"]["cell"]["options"]["pattern"] = r"(?:A|B) (?P<force>[-+]?\d+\.\d+)"
    (tmp_path / "rig.yaml").write_text(yaml_text(described))
    done = rigd("new", "rig", "mine", "--from", "rig.yaml", cwd=tmp_path)
    assert done.code == 0, done.err
    assert "no wire.yaml, for the real drivers on simulated devices: no line can be" in done.out
    assert not (tmp_path / "mine" / "wire.yaml").exists()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("sensor: load_cell, unit: N", "sensor: load, unit: N", "no sensor 'load'"),
        ("sensor: load_cell, unit: N", "sensor: load_cell, unit: kg", "is in N, not in kg"),
        ("answer: '{force:+9.3f} N'", "answer: '{weight} N'", "cannot be filled in: 'weight'"),
        ("drive: spindle}", "drive: motor}", "no drive 'motor' of mode speed"),
    ],
)
def test_wrong_wiring_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = (CONFIGS / "wire_tribometer.yaml").read_text("utf-8")
    assert old in text
    text = text.replace("parameters: plants", f"parameters: {CONFIGS}/plants")
    (tmp_path / "spoilt.yaml").write_text(text.replace(old, new))
    with pytest.raises(ConfigError) as caught:
        load_rig(tmp_path / "spoilt.yaml")
    assert words in str(caught.value)
