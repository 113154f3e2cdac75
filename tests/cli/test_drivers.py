"""``rigd drivers``: everything installed is listed, in any state."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path

import pytest
from support.commands.command import rigd

GROUPS = {
    "rigd.drivers": "driver",
    "rigd.links": "link",
    "rigd.plants": "plant",
    "rigd.simulations": "simulation",
    "rigd.observers": "observer",
}


@pytest.fixture
def with_broken(tmp_path: Path) -> Path:
    """A folder in which packages are installed that are broken in several ways."""
    info = tmp_path / "acme-2.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: acme\nVersion: 2.1\n")
    (info / "entry_points.txt").write_text(
        "[rigd.drivers]\n"
        "acme-missing = acme_missing:Driver\n"
        "acme-raises = acme_raises:Driver\n"
        "acme-leaves = acme_leaves:Driver\n"
        "acme-no-driver = acme_plain:Thing\n"
        "acme-declare = acme_declare:Declare\n"
        "serial-scale = acme_missing:Scale\n"
        "[rigd.plants]\n"
        "acme-plant = acme_plain:absent\n"
    )
    (tmp_path / "acme_raises.py").write_text("raise RuntimeError('no licence [found]')\n")
    (tmp_path / "acme_leaves.py").write_text("raise SystemExit('not here')\n")
    (tmp_path / "acme_plain.py").write_text("class Thing: pass\n")
    (tmp_path / "acme_declare.py").write_text(
        "from rigd.sdk import SlowDriver\n"
        "class Declare(SlowDriver):\n"
        "    title = 'declares badly'\n"
        "    @classmethod\n"
        "    def declare(cls, config):\n"
        "        raise OSError('no such port')\n"
        "    async def open(self): ...\n"
        "    async def run(self, emit): ...\n"
    )
    return tmp_path


def test_everything_installed_is_listed_by_kind(tmp_path: Path) -> None:
    listed = rigd("drivers", cwd=tmp_path)
    assert listed.code == 0
    for group in GROUPS:
        for point in entry_points(group=group):
            assert f"  {point.name} " in listed.out
    assert "broken" not in listed.out


def test_json_holds_options_channels_setpoints_of_every_driver(tmp_path: Path) -> None:
    found = rigd("drivers", "--json", cwd=tmp_path).json
    assert {(item["kind"], item["name"]) for item in found} == {
        (kind, point.name) for group, kind in GROUPS.items() for point in entry_points(group=group)
    }
    amplifier = next(item for item in found if item["name"] == "sim-lugre-amplifier")
    assert amplifier["title"].startswith("wheel servo")
    assert amplifier["package"] == "rigd"
    assert [channel["name"] for channel in amplifier["channels"]] == ["current", "current_raw"]
    (setpoint,) = amplifier["setpoints"]
    assert (setpoint["name"], setpoint["unit"], setpoint["low"]) == ("current", "A", -2.0)
    scale = next(item for item in amplifier["options"] if item["name"] == "monitor_scale")
    assert scale["unit"] == "A/V"
    assert scale["default"] == "2.5 A/V"
    assert scale["doc"] == "Current per volt of the monitor output."
    assert scale["required"] is False


def test_driver_is_shown_in_full(tmp_path: Path) -> None:
    shown = rigd("drivers", "serial-scale", cwd=tmp_path)
    assert shown.code == 0
    for text in ("mt-sics or kern-kcp or and-d", "required", "Serial port", "mass", "kg", "tare"):
        assert text in shown.out
    link = rigd("drivers", "sim-lugre-belt", cwd=tmp_path).out
    assert "setpoints of" in link
    assert "clutch: 1 engaged" in link


def test_channels_that_depend_on_options_are_marked(tmp_path: Path) -> None:
    info = tmp_path / "thermo-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: thermo\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[rigd.drivers]\nthermo = thermo:Thermo\n")
    (tmp_path / "thermo.py").write_text(
        "from rigd.sdk import DriverConfig, SlowDriver\n"
        "class Config(DriverConfig):\n"
        "    port: str\n"
        "    '''Where it is.'''\n"
        "class Thermo(SlowDriver):\n"
        "    '''Measures.'''\n"
        "    Config = Config\n"
        "    @classmethod\n"
        "    def declare(cls, config): ...\n"
        "    async def open(self): ...\n"
        "    async def run(self, emit): ...\n"
    )
    shown = rigd("drivers", "thermo", cwd=tmp_path)
    assert shown.code == 0
    assert "driver of thermo 1.0" in shown.out
    assert "channels and setpoints depend on its options" in shown.out


def test_broken_driver_is_reported_and_hides_no_other(with_broken: Path) -> None:
    listed = rigd("drivers", cwd=with_broken)
    assert listed.code == 0
    assert "broken: ModuleNotFoundError: No module named 'acme_missing'" in listed.out
    assert "broken: RuntimeError: no licence [found]" in listed.out
    assert "is not derived from AnyDriver of rigd.sdk" in listed.out
    assert "sim-lugre-truth" in listed.out
    lines = listed.out.splitlines()
    assert sum(line.startswith("  serial-scale ") for line in lines) == 2  # both that claim it
    assert any("acme-plant" in line and "AttributeError" in line for line in lines)

    found = rigd("drivers", "--json", cwd=with_broken).json
    broken = {item["name"]: item["broken"] for item in found if item["broken"]}
    assert broken["acme-declare"] == "OSError: no such port"
    assert broken.keys() == {
        "acme-missing", "acme-raises", "acme-no-driver", "acme-declare", "serial-scale",
        "acme-plant", "acme-leaves",
    }  # fmt: skip


def test_broken_or_absent_name_is_an_error(with_broken: Path) -> None:
    shown = rigd("drivers", "acme-raises", cwd=with_broken)
    assert shown.code == 2
    assert "no licence [found]" in shown.out
    absent = rigd("drivers", "serial-scales", cwd=with_broken)
    assert absent.code == 2
    assert "'serial-scales' is not installed" in absent.err
    assert "did you mean 'serial-scale'?" in absent.err
