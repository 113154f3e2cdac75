"""Plug-ins that two packages give under one name, and a system without any."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rigd.analysis.friction.registry import installed_laws
from rigd.analysis.plan import find_analysis
from rigd.cli.main import main
from rigd.computed.observers.model import ObserverModel
from rigd.config import registry
from rigd.config.registry import find, find_driver, find_link, find_plant, find_simulation
from rigd.model import ConfigError
from rigd.model.errors import Exit, RecordingError

#: A shipped name of each group.
NAMES = {
    group: sorted(registry.installed(group))[0]
    for group in (
        registry.ANALYSES, registry.DRIVERS, registry.FRICTION_LAWS, registry.LINKS,
        registry.OBSERVERS, registry.PLANTS, registry.SIMULATIONS,
    )
}  # fmt: skip
FINDERS: dict[str, Callable[[str], object]] = {
    registry.ANALYSES: find_analysis,
    registry.DRIVERS: find_driver,
    registry.LINKS: find_link,
    registry.PLANTS: find_plant,
    registry.SIMULATIONS: find_simulation,
    registry.OBSERVERS: lambda name: find(registry.OBSERVERS, ObserverModel, "observer", name),
    registry.FRICTION_LAWS: lambda name: find(registry.FRICTION_LAWS, object, "law", name),
}


@pytest.fixture(params=["before", "after"])
def evil(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """Install a package that gives each of the names, before or after rigd on the path."""
    info = tmp_path / "aaa_evil-0.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: aaa-evil\nVersion: 0.1\n")
    (info / "entry_points.txt").write_text(
        "".join(f"[{group}]\n{name} = evil_plugin:Evil\n" for group, name in NAMES.items())
    )
    place = [str(tmp_path)]
    monkeypatch.setattr(
        sys, "path", place + sys.path if request.param == "before" else sys.path + place
    )
    registry.given_names.cache_clear()
    yield
    registry.given_names.cache_clear()


@pytest.mark.parametrize("group", NAMES)
def test_name_of_two_packages_is_an_error(evil: None, group: str) -> None:
    with pytest.raises(ConfigError) as caught:
        FINDERS[group](NAMES[group])
    said = str(caught.value)
    assert "aaa-evil 0.1 (evil_plugin:Evil)" in said
    assert "and rigd " in said
    assert "uninstall one of the packages" in said


def test_other_names_are_found_beside_a_clash(evil: None) -> None:
    assert find_driver(sorted(registry.installed(registry.DRIVERS))[1]) is not None
    laws, broken = installed_laws()
    assert NAMES[registry.FRICTION_LAWS] not in laws
    assert any("aaa-evil" in reason for reason in broken)


def test_rig_with_doubled_driver_names_place(
    evil: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "rig.yaml"
    rig.write_text(
        f"rig: r\ntitle: R\ncycle: 1 kHz\ninterlocks: []\n"
        f"devices:\n  a:\n    driver: {NAMES[registry.DRIVERS]}\n"
    )
    assert main(["check", str(rig)]) == Exit.BAD_INPUT
    assert "rig.yaml:7:13: driver" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["drivers", "analyses"])
def test_lists_show_both_packages(
    evil: None, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command]) == Exit.OK
    assert "broken: both aaa-evil 0.1 (evil_plugin:Evil) and rigd" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["drivers", "analyses"])
def test_list_without_plugins_is_empty(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("rigd.cli.plugins.inventory.entry_points", lambda **_: [])
    monkeypatch.setattr("importlib.metadata.entry_points", lambda **_: [])
    assert main([command]) == Exit.OK
    assert "installed" in capsys.readouterr().err
    assert main([command, "--json"]) == Exit.OK
    assert capsys.readouterr().out == "[]\n"
    assert main([command, "absent"]) == Exit.BAD_INPUT


def test_debug_stands_before_the_command_too() -> None:
    assert main(["--debug", "analyses"]) == Exit.OK
    for words in (["--debug", "info", "absent.mcap"], ["info", "absent.mcap", "--debug"]):
        with pytest.raises(RecordingError):
            main(words)
