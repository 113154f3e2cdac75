"""`rigd read`, `rigd tare`, `rigd doctor` at the wire, and on rigs that are broken."""

from __future__ import annotations

import json
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from support.commands.command import Ended, rigd, start
from support.wire import WireRig, wire_rig, write_rig

from rigd.config.loader import channel_names, load_rig
from rigd.engine.shared import state_folder
from rigd.model.errors import Exit

#: Of the simulated scale: its noise may show as the last digit.
DIVISION_KG = 0.001


@pytest.fixture(scope="module")
def wire(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    with wire_rig(tmp_path_factory.mktemp("wire"), "wire-manual") as rig:
        yield rig


def other(wire: WireRig, folder: Path, **replaced: tuple[str, str]) -> Path:
    """Return the rig file with some text replaced, of the same simulated devices."""
    text = wire.rig.read_text().replace("rig: wire-manual", "rig: wire-other")
    for old, new in replaced.values():
        assert old in text, old
        text = text.replace(old, new)
    path = folder / "other.yaml"
    path.write_text(text)
    return path


def drives(wire: WireRig) -> dict[str, Any]:
    return {name: part for name, part in wire.parts().items() if "enabled" in part}


def checks(done: Ended) -> dict[str, dict[str, Any]]:
    """Return the checks of the rig by name; its exit code must be what all come to."""
    failed = [item for item in done.json["checks"] if item["verdict"] == "fail"]
    assert done.code == (Exit.BLOCKED if failed else Exit.OK)
    rig = (item for item in done.json["checks"] if item["group"].startswith("rig "))
    found: dict[str, dict[str, Any]] = {}
    for item in rig:
        found.setdefault(item["name"], item)  # the first: found or not
    return found


def test_read_shows_every_channel_and_arms_nothing(wire: WireRig, tmp_path: Path) -> None:
    done = rigd("read", "--rig", wire.rig, "--once", "--json", cwd=tmp_path)
    assert done.code == 0, done.err
    channels = done.json["channels"]
    assert list(channels) == channel_names(load_rig(wire.rig))
    assert {channel["state"] for channel in channels.values()} == {"ok"}
    shown, unit = str(wire.parts()["scale"]["shown"]).split()
    # Its last digit flickers between the two looks.
    assert (channels["scale.mass"]["value"], unit) == (pytest.approx(float(shown), abs=0.003), "kg")
    assert len(drives(wire)) == 3
    assert not any(part["enabled"] for part in drives(wire).values())
    assert not list(tmp_path.iterdir())  # nothing is recorded


def test_read_for_duration_prints_lines_of_chosen_channels(wire: WireRig, tmp_path: Path) -> None:
    done = rigd(
        "read", "scale", "carriage.position", "--rig", wire.rig, "--for", "1.5 s", cwd=tmp_path
    )
    assert done.code == 0, done.err
    lines = [line.split() for line in done.out.splitlines()]
    assert {line[1] for line in lines} == {"scale.mass", "carriage.position"}
    assert len(lines) >= 4
    assert {line[3] for line in lines if line[1] == "scale.mass"} == {"kg"}
    times = [line[0] for line in lines]
    assert times == sorted(times)


def test_read_shows_active_interlock_and_continues(wire: WireRig, tmp_path: Path) -> None:
    rig = other(wire, tmp_path, far=("high: 1.65 m", "high: -10 mm"))
    done = rigd("read", "carriage", "--rig", rig, "--once", "--json", cwd=tmp_path)
    assert done.code == 0, done.err
    (standing,) = done.json["interlocks"]
    assert (standing["name"], standing["action"]) == ("overrun_far", "abort")
    assert "above its limit -0.01 m" in standing["reason"]


def test_rig_in_use_is_refused_until_ctrl_c(wire: WireRig, tmp_path: Path) -> None:
    reading = start(["read", "scale", "--rig", wire.rig, "--json"], tmp_path)
    assert reading.process.stdout is not None
    first = json.loads(reading.process.stdout.readline())
    assert first["channels"]["scale.mass"]["state"] == "ok"
    refused = rigd("tare", "scale", "--rig", wire.rig, cwd=tmp_path)
    assert refused.code == Exit.BLOCKED
    assert f"process {reading.process.pid} (rigd read)" in refused.err
    reading.signal(signal.SIGINT)
    ended = reading.end()
    assert ended.code == 0
    assert ended.err == f"rig wire-manual ({wire.rig})\n"
    assert not (state_folder() / ".look" / "wire-manual").exists()
    again = rigd("read", "scale", "--rig", wire.rig, "--once", cwd=tmp_path)
    assert again.code == 0, again.err
    assert not wire.parts()["scale"]["streaming"]  # left quiet


def test_a_device_that_falls_silent_ends_a_read(wire: WireRig, tmp_path: Path) -> None:
    reading = start(["read", "wheel_encoder", "--rig", wire.rig, "--json"], tmp_path)
    assert reading.process.stdout is not None
    assert reading.process.stdout.readline()
    wire.ask(do="fault", part="wheel_encoder", fault="silent")
    try:
        ended = reading.end()
    finally:
        wire.ask(do="clear")
    assert ended.code == Exit.TRIPPED
    assert "wheel_encoder" in ended.err


def test_tare_works_for_slow_and_cycle_devices(wire: WireRig, tmp_path: Path) -> None:
    grams = other(
        wire, tmp_path, display=("      unit: kg\n", "      unit: kg\n    display: {mass: g}\n")
    )
    done = rigd("tare", "scale", "--rig", grams, cwd=tmp_path)
    assert done.code == 0, done.err
    _, _, left = done.out.partition("scale.mass is now ")
    assert abs(float(left.removesuffix(" g\n"))) <= 1000 * DIVISION_KG
    assert wire.parts()["scale"]["tare_kg"] == pytest.approx(3.959, abs=0.01)
    done = rigd("tare", "traction", "--rig", wire.rig, "--json", cwd=tmp_path)
    assert done.code == 0, done.err
    assert done.json["reply"] == "tare: accepted"
    assert done.json["channels"]["traction.force"]["value"] == pytest.approx(0, abs=0.5)
    assert not any(part["enabled"] for part in drives(wire).values())


def test_tare_reports_refused_and_unknown_actions(wire: WireRig, tmp_path: Path) -> None:
    loaded = rigd("tare", "scale", "--action", "zero", "--rig", wire.rig, cwd=tmp_path)
    assert loaded.code == Exit.TRIPPED
    assert "refuses to zero" in loaded.err
    unknown = rigd("tare", "wheel_servo", "--rig", wire.rig, cwd=tmp_path)
    assert unknown.code == Exit.BAD_INPUT
    assert "no action 'tare'" in unknown.err
    assert "scale" in unknown.err


def test_doctor_finds_proves_and_measures_everything(wire: WireRig, tmp_path: Path) -> None:
    done = rigd("doctor", "--rig", wire.rig, "--seconds", "2", "--json", cwd=tmp_path)
    rig = load_rig(wire.rig)
    found = checks(done)
    for name in [*rig.links, *rig.devices]:
        assert found[name]["verdict"] == "ok", found[name]
    assert "USB-6009" in found["accelerometer"]["found"]
    everything = done.json["checks"]
    proven = [item for item in everything if item["group"] == "watchdogs"]
    assert {item["name"] for item in proven} == set(drives(wire))
    for item in proven:
        assert 0 < item["figures"]["safe_after_s"] <= item["figures"]["bound_s"]
    named = {item["name"]: item for item in everything}
    not_ok = [item for item in everything if item["verdict"] != "ok"]
    assert set(channel_names(rig)) <= set(named), not_ok
    assert named["traction.force"]["figures"]["noise"] > 0
    assert "only rises" in named["accelerometer.device_time"]["found"]
    assert not any(part["enabled"] for part in drives(wire).values())


@pytest.fixture
def in_pounds(wire: WireRig) -> Iterator[None]:
    """The scale shows pounds."""
    wire.ask(do="fault", part="scale", fault="unit")
    yield
    wire.ask(do="clear")


@pytest.mark.usefixtures("in_pounds")
def test_doctor_names_every_fault_beside_sound_devices(wire: WireRig, tmp_path: Path) -> None:
    """The node of the carriage is wrong in the file, the unit of the scale at the device."""
    rig = other(wire, tmp_path, node=("node: 12 ", "node: 13 "))
    found = checks(rigd("doctor", "--rig", rig, "--seconds", "0.5", "--json", cwd=tmp_path))
    assert found["carriage"]["verdict"] == "fail"
    assert "node 13" in found["carriage"]["found"]
    assert "11, 12" in found["carriage"]["found"]
    assert "`node`" in found["carriage"]["advice"]
    assert found["scale"]["verdict"] == "fail"
    assert "shows lb, the rig expects kg" in found["scale"]["found"]
    assert "press UNIT" in found["scale"]["advice"]
    assert found["wheel_encoder"]["verdict"] == "ok"
    assert found["at rest"]["found"] == "not measured"
    assert not any(part["enabled"] for part in drives(wire).values())


@pytest.mark.usefixtures("in_pounds")
def test_read_refuses_a_scale_in_pounds(wire: WireRig, tmp_path: Path) -> None:
    read = rigd("read", "scale", "--rig", wire.rig, "--once", cwd=tmp_path)
    assert read.code == Exit.BLOCKED
    assert "shows lb" in read.err


def test_doctor_without_simulation_suggests_rigd_sim(tmp_path: Path) -> None:
    rig = write_rig(tmp_path, "wire-nobody").rig
    done = rigd("doctor", "--rig", rig, "--seconds", "0.5", "--json", cwd=tmp_path)
    assert done.code == Exit.BLOCKED
    found = checks(done)
    assert "rigd sim" in found["servo_bus"]["advice"]
    assert found["wheel_servo"]["found"] == "not tested: servo_bus is not open"
    for name in ("encoder_bus", "carriage", "accelerometer", "scale"):
        assert found[name]["verdict"] == "fail"
