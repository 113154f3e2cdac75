"""A layout shows what a recording of its rig has, in the form that its viewer loads."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from foxglove.layouts import PlotConfig, PlotSeries, StateTransitionsConfig, StateTransitionsSeries
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from support.recordings.shipped_runs import Pair, play

from rigd.cli.main import main
from rigd.config.loader import load_rig
from rigd.engine.cycle.wiring import streams_of
from rigd.model import Channel, Stream
from rigd.record import Recording
from rigd.record.layout import FORMATS, layout
from rigd.record.layout.plots import MOST_PLOTS, tabs_of
from rigd.sdk.shipped_files import shipped_folder

RIGS = {
    "lugre-1": "quick",
    "angle-1": "approach_angles",
    "articulated-1": "straight_speeds",
}


def fields_of(path: Path) -> set[str]:
    """``/topic/field`` of all that a recording has, as another reader finds it."""
    with AnyReader([path], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        return {
            f"{item.topic}/{name}"
            for item in reader.connections
            for name, _ in reader.typestore.fielddefs[item.msgtype][1]
        }


def panels(text: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(text)["configById"]
    return found


def placed(node: object) -> Iterator[str]:
    """Yield the panels in a tree of splits."""
    if isinstance(node, dict):
        assert node["direction"] in ("row", "column")
        assert 0 < node["splitPercentage"] < 100
        yield from placed(node["first"])
        yield from placed(node["second"])
    else:
        yield str(node)


def shown(streams: Sequence[Stream]) -> tuple[set[str], set[str]]:
    """``/topic/field`` in the layouts of Foxglove and of PlotJuggler."""
    paths = {
        path["value"].replace(".", "/")
        for panel in panels(layout(streams, "foxglove")).values()
        for path in panel.get("paths", [])
    }
    root = ElementTree.fromstring(layout(streams, "plotjuggler"))
    return paths, {str(curve.get("name")) for curve in root.iter("curve")}


@pytest.mark.parametrize("rig", RIGS)
def test_layouts_name_only_what_is_recorded(tmp_path: Path, rig: str) -> None:
    path = tmp_path / "run.mcap"
    procedure = shipped_folder("procedures") / f"{RIGS[rig]}.yaml"
    play(Pair(procedure, load_rig(rig)), 0, path, trials=1)
    recorded, streams = fields_of(path), Recording.open(path).streams
    for names in shown([item for item in streams_of(load_rig(rig)) if item.name in streams]):
        assert names <= recorded
    paths, curves = shown(list(streams.values()))
    assert paths <= recorded
    assert {"/trial/number", "/trial/step"} <= curves <= recorded
    # All but raw readings, status words and what is known of a trial in words.
    left = {name for name in recorded - curves if not re.search(r"_raw$|/counts$|/status$", name)}
    assert {name.split("/")[1] for name in left} == {"trial", "events"}


def test_foxglove_layout_has_keys_of_its_sdk() -> None:
    text = layout(streams_of(load_rig("lugre-1")), "foxglove")
    whole, found = json.loads(text), panels(text)
    known = {
        "Plot": (PlotConfig(), PlotSeries()),
        "StateTransitions": (StateTransitionsConfig(), StateTransitionsSeries()),
    }
    for name, panel in found.items():
        kind = name.partition("!")[0]
        if kind != "Tab":
            config, series = (set(item._to_dict()) for item in known[kind])
            assert set(panel) <= config | {"foxglovePanelTitle"}
            assert all(set(path) <= series for path in panel["paths"])
    tabs = found["Tab!streams"]["tabs"]
    used = [*placed(whole["layout"]), *(name for tab in tabs for name in placed(tab["layout"]))]
    assert sorted(used) == sorted(found)


def test_plotjuggler_layout_counts_its_plots() -> None:
    """It reads beyond its own lists if sizes or counts are wrong."""
    root = ElementTree.fromstring(layout(streams_of(load_rig("articulated-1")), "plotjuggler"))
    (window,) = root.findall("tabbed_widget")
    assert (window.get("name"), window.get("parent")) == ("Main Window", "main_window")
    for tab in window.findall("Tab"):
        (column,) = tab.findall("Container/DockSplitter")
        sizes = [float(size) for size in str(column.get("sizes")).split(";")]
        assert len(column) == len(sizes) == int(str(column.get("count")))
        assert sum(sizes) == pytest.approx(1, abs=1e-4)
        assert all(len(area.findall("plot")) == 1 for area in column)
    assert root.find("colorMaps") is None  # one that its user does not have ends PlotJuggler 3


def test_overview_shows_commanded_beside_measured() -> None:
    drive = Stream(
        "drive",
        (
            Channel("angle", "rad"),
            Channel("speed", "rad/s"),
            Channel("speed_raw", "V", raw_of="speed"),
            Channel("speed_setpoint", "rad/s"),
        ),
    )
    raw = Stream("raw", (Channel("volts", "V", raw_of="force"),))
    many = [Stream(f"scale{number}", (Channel("mass", "kg"),)) for number in range(9)]
    cycle = Stream("cycle", (Channel("spent", "s"),))
    overview, first, second, *_ = tabs_of([cycle, drive, raw, *many])
    assert [plot.fields for plot in overview.plots[:2]] == [("speed", "speed_setpoint"), ("volts",)]
    assert len(overview.plots) == MOST_PLOTS
    assert (first.title, second.title) == ("cycle", "drive")
    assert [plot.title for plot in second.plots] == ["drive angle [rad]", "drive speed [rad/s]"]


@pytest.mark.parametrize("viewer", list(FORMATS))
def test_command_writes_a_layout_and_replaces_none(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    viewer: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["layout", "lugre-1", "--to", viewer]) == 0
    path = Path(capsys.readouterr().out.strip())
    assert path.name.startswith(f"lugre-1.{viewer}.")
    before = path.read_bytes()
    assert b"wheel_servo" in before
    assert main(["layout", "angle-1", "--to", viewer, "--output", str(path)]) == 2
    assert "--overwrite replaces it" in capsys.readouterr().err
    assert path.read_bytes() == before
    assert main(["layout", "angle-1", "--to", viewer, "--output", str(path), "--overwrite"]) == 0
    assert b"gauge_a" in path.read_bytes()


def test_folder_that_cannot_be_made_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "none").touch()
    output = tmp_path / "none" / "x.json"
    assert main(["layout", "lugre-1", "--to", "foxglove", "--output", str(output)]) == 7
    assert f"cannot make the folder {output.parent}" in capsys.readouterr().err
