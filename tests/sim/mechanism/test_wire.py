"""A described rig at the wire: the real drivers move its mechanism over CAN and an NI server."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.commands.command import rigd
from support.wire import WireRig, free_ports

from rigd.cli.plugins.new_rig.folder import write_rig
from rigd.cli.plugins.new_rig.questions import defaults, described
from rigd.config.loader import load_rig
from rigd.model.errors import ConfigError
from rigd.record.read.reader import Recording

TEXT = (
    described("bench", defaults)
    .replace("values: [12 rad/s, 24 rad/s]", "values: [5 rad/s]")
    .replace("for: 5 s", "for: 1.5 s")
    .replace("last 2 s of hold", "last 1 s of hold")
)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lab") / "bench"
    write_rig("bench", TEXT, Path("rig.yaml"), folder)
    first = folder / "procedures" / "first.yaml"
    text = first.read_text("utf-8").replace("repeats: 3", "repeats: 1")
    first.write_text(text.partition("accept:")[0], "utf-8")  # one trial shows no repeatability
    return folder


@pytest.fixture
def wire(lab: Path) -> Iterator[WireRig]:
    with tempfile.TemporaryDirectory(prefix="rigd-") as sockets:  # names of sockets are short
        text = (lab / "wire.yaml").read_text("utf-8").replace("/tmp/rigd-bench", sockets)
        rig = lab / "own.yaml"
        rig.write_text(text.replace("31790", str(free_ports(1)[0])), "utf-8")
        served = WireRig(rig, lab)
        served.start()
        try:
            yield served
        finally:
            served.stop()


def test_real_drivers_turn_the_described_disk(wire: WireRig, lab: Path) -> None:
    done = rigd("run", "procedures/first.yaml", "--rig", "own.yaml", "--output", "wire.mcap",
                cwd=lab)  # fmt: skip
    assert done.code == 0, done.out + done.err
    recording = Recording.open(lab / "wire.mcap")
    speed, force = recording.read("spindle")["speed"], recording.read("daq")["force"]
    heat = recording.read("daq")["temperature"]
    assert np.median(heat) == pytest.approx(293.15, abs=2.0)  # room; the card's volts are of degC
    assert np.nanmax(speed) == pytest.approx(5.0, abs=0.4)
    assert np.median(force[force > 0.5]) == pytest.approx(1.2, abs=0.15)  # 0.123 of 9.81 N


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("sensor: load_cell", "sensor: load", "the mechanism has no sensor 'load'"),
        ("ai0: {sensor", "ai9: {sensor", "no input 'ai9'"),
        ("{sensor: load_cell, scale: 5 N/V}", "{sensor: load_cell, scale: 5 V}", "in N/V"),
        ("drive: spindle", "drive: spindles", "no drive 'spindles' of mode speed"),
        ("bus: drive_bus", "bus: drives", "no bus 'drives'"),
    ],
)
def test_wrong_wiring_is_refused_with_its_line(lab: Path, old: str, new: str, words: str) -> None:
    text = (lab / "wire.yaml").read_text("utf-8")
    assert old in text
    line = text[: text.index(old)].count("\n") + 1
    (lab / "spoilt.yaml").write_text(text.replace(old, new, 1), "utf-8")
    with pytest.raises(ConfigError) as caught:
        load_rig(lab / "spoilt.yaml")
    assert f"spoilt.yaml:{line}:" in str(caught.value)
    assert words in str(caught.value)
