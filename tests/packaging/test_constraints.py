"""The tests run with the versions that are pinned: of Python in scripts/constraints.txt, of npm in
the package-lock.json beside each package.json; both fit what is wanted."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
LINES = (ROOT / "scripts" / "constraints.txt").read_text().splitlines()
FILE = tomllib.loads((ROOT / "pyproject.toml").read_text())
PROJECT = FILE["project"]
PYTHONS = ("3.11", "3.12", "3.13")


def spelt(requirement: Requirement) -> str:
    return requirement.name.lower().replace("_", "-").replace(".", "-")


def wanted() -> list[Requirement]:
    """Return what rigd, its extras and its build need."""
    listed = [*PROJECT["dependencies"], *FILE["build-system"]["requires"]]
    listed += [each for extra in PROJECT["optional-dependencies"].values() for each in extra]
    return [each for each in map(Requirement, listed) if each.name != "rigd"]


def holds(requirement: Requirement, python: str) -> bool:
    """Return whether it is for this machine with that Python."""
    environment = {
        **{name: str(value) for name, value in default_environment().items()},
        "python_version": python,
        "python_full_version": f"{python}.9",
    }
    return requirement.marker is None or requirement.marker.evaluate(environment)


@pytest.mark.parametrize("python", PYTHONS)
def test_every_library_is_pinned_as_wanted(python: str) -> None:
    pinned = {
        spelt(each): str(each.specifier).removeprefix("==")
        for each in map(Requirement, LINES)
        if holds(each, python)
    }
    missing = [
        str(each)
        for each in wanted()
        if holds(each, python) and not each.specifier.contains(pinned.get(spelt(each), "0"))
    ]
    assert missing == [], "run `make lock`"


def test_every_line_pins_one_version() -> None:
    pins = [[each.operator for each in Requirement(line).specifier] for line in LINES]
    assert pins == [["=="]] * len(LINES)


def test_no_line_names_a_host() -> None:
    assert [line for line in LINES if "//" in line or "@" in line] == []


@pytest.mark.parametrize("folder", [".", "tests/record/strict"])
def test_npm_packages_are_pinned_as_wanted(folder: str) -> None:
    wanted = json.loads((ROOT / folder / "package.json").read_text())
    text = (ROOT / folder / "package-lock.json").read_text()
    packages = json.loads(text)["packages"]
    for group in ("dependencies", "devDependencies"):
        assert packages[""].get(group) == wanted.get(group), "run `make lock`"
    for name, version in {
        **wanted.get("dependencies", {}),
        **wanted.get("devDependencies", {}),
    }.items():
        assert packages[f"node_modules/{name}"]["version"] == version
    for name, package in packages.items():
        assert not name or re.fullmatch(r"\d+(\.\d+){2}\S*", package["version"])
        assert not name or package["integrity"].startswith("sha512-")
    assert '"resolved"' not in text  # no host: npm takes the registry that it is set to


def test_each_npm_package_has_its_lock() -> None:
    installs = (ROOT / "Makefile").read_text() + (ROOT / "tests/record/conftest.py").read_text()
    assert "npm ci" in installs and "no-package-lock" not in installs
