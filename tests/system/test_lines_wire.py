"""Devices that send lines, at the wire: a run reads them, and ends if they are not heard."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from support.commands.command import rigd
from support.wire import LINES, WireRig, wire_rig

from rigd.record import Recording

WATCH = """\
procedure: watch
title: Nothing moves
doc: All is recorded.
trial:
  steps:
    - step: watch
      for: 2 s
"""
FAULT = """\
    - fault: {part: climate, fault: short}
    - step: watch_on
      for: 60 s
"""


#: A slow device and one of another pace in a formula.
DERIVED = """\
derived:
  both.product: {is: gauge.force * climate.humidity}
  both.passed: {is: "integral(where(gauge.force < 1 kN, 1, 1))"}

interlocks:
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WireRig]:
    folder = tmp_path_factory.mktemp("wire")
    with wire_rig(folder, replaced={"interlocks:\n": DERIVED}, shipped=LINES) as rig:
        yield rig


@pytest.fixture(autouse=True)
def sound(bench: WireRig) -> Iterator[None]:
    yield
    bench.ask(do="clear")


def watch(folder: Path, fault: str = "") -> Path:
    procedure = folder / "watch.yaml"
    procedure.write_text(WATCH + fault)
    return procedure


def test_run_records_what_the_lines_show(bench: WireRig, tmp_path: Path) -> None:
    bench.ask(do="change", quantity="gauge.force", value=-12.5)
    output = tmp_path / "run.mcap"
    ran = rigd("run", watch(tmp_path), "--rig", bench.rig, "--output", output, cwd=tmp_path)
    assert ran.code == 0, ran.err
    recording = Recording.open(output)
    gauge, climate = recording.read("gauge"), recording.read("climate")
    assert np.abs(gauge["force"] + 12.5).max() < 0.02
    assert len(gauge) >= 10
    assert np.abs(climate["temperature"] - 294.65).max() < 0.2
    assert np.abs(climate["humidity"] - 0.45).max() < 0.01
    # Before the trial, while nothing is armed, a device may have given no row yet.
    both = recording.trial(1)["both"]
    assert len(both) >= 190  # one row per cycle, though the devices are slow
    assert np.abs(both["product"] + 12.5 * 0.45).max() < 0.3
    assert not np.any(both["status"])
    assert both["passed"][-1] == pytest.approx(2.0, abs=0.5)


def test_run_ends_at_unreadable_lines_with_cause(bench: WireRig, tmp_path: Path) -> None:
    procedure = watch(tmp_path, FAULT)
    ran = rigd("run", procedure, "--rig", bench.rig, cwd=tmp_path)
    assert ran.code == 4
    assert "it has 2 columns, expected 3" in " ".join(ran.out.split())


def test_doctor_shows_what_came_instead(bench: WireRig, tmp_path: Path) -> None:
    bench.ask(do="fault", part="gauge", fault="comma")
    found = rigd("doctor", "--rig", bench.rig, "--seconds", "1", cwd=tmp_path)
    shown = " ".join(found.out.split())
    assert "the last is b'" in shown
    assert "group 'force'" in shown or "does not match" in shown
