"""``rigd new``: what it makes installs, conforms and passes its own tests as made."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
import zipfile
from importlib.metadata import entry_points
from pathlib import Path

import pytest
from support.commands.command import rigd

from rigd.cli.plugins.new import KINDS, RETIRED, check_name, module_name, rendered
from rigd.model.errors import ConfigError

ROOT = Path(__file__).parents[2]
MADE = (*KINDS, "plant", "analysis", "friction-law")

RIG = """\
rig: bench-2
title: A rig with a driver of our own
cycle: 1 kHz
devices:
  mine:
    driver: {name}
    options: {{port: 7000}}
{limits}
interlocks: []
constants: {{}}
"""
LIMITS = {"fast": "    limits:\n      speed: {low: -1 m/s, high: 1 m/s, rate: 5 m/s^2}\n"}


def run(*command: str | Path, cwd: Path, site: Path | None = None) -> str:
    """Run a command that must succeed, with the packages in ``site`` installed."""
    paths = [] if site is None else [str(site)]
    done = subprocess.run(
        [sys.executable, "-m", *map(str, command)],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=240,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


def installed(package: Path, folder: Path, *, by_pip: bool = False) -> Path:
    """Return a folder below ``folder`` into which the package is installed.

    Its wheel is built by pip, or, which takes a third of the time, by what pip calls.
    """
    if by_pip:
        run(
            "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation",
            "--disable-pip-version-check", "--wheel-dir", folder, package, cwd=folder,
        )  # fmt: skip
    else:
        run("hatchling", "build", "--target", "wheel", "--directory", folder, cwd=package)
    (wheel,) = folder.glob("*.whl")
    site = folder / "site"
    zipfile.ZipFile(wheel).extractall(site)
    return site


@pytest.mark.parametrize("kind", KINDS)
def test_new_package_installs_and_passes_its_own_tests(kind: str, tmp_path: Path) -> None:
    name = f"acme-{kind}"
    made = rigd("new", "driver", name, "--kind", kind, "--folder", tmp_path, cwd=tmp_path)
    assert made.code == 0, made.err
    assert f"pytest {tmp_path / name}" in made.out

    site = installed(tmp_path / name, tmp_path, by_pip=kind == "fast")
    assert (site / f"acme_{kind}" / "py.typed").is_file()

    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    tested = run(
        "pytest", "-q", "-p", "no:cacheprovider", tmp_path / name / "tests", cwd=elsewhere,
        site=site,
    )  # fmt: skip
    assert "passed" in tested

    shown = run("rigd", "drivers", name, cwd=elsewhere, site=site)
    assert f"driver of {name} 0.1.0" in shown
    assert "port" in shown
    rig = RIG.format(name=name, limits=LIMITS.get(kind, ""))
    (elsewhere / "rig.yaml").write_text(rig)
    assert "1 devices" in run("rigd", "check", "rig.yaml", cwd=elsewhere, site=site)


def test_an_analysis_that_is_made_passes_its_tests(tmp_path: Path) -> None:
    made = rigd("new", "analysis", "acme-coast", "--folder", tmp_path, cwd=tmp_path)
    assert made.code == 0, made.err
    assert f"pytest {tmp_path / 'acme-coast'}" in made.out
    site = installed(tmp_path / "acme-coast", tmp_path)
    assert (site / "acme_coast" / "py.typed").is_file()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    tested = run(
        "pytest", "-q", "-p", "no:cacheprovider", tmp_path / "acme-coast" / "tests",
        cwd=elsewhere, site=site,
    )  # fmt: skip
    assert "passed" in tested
    shown = run("rigd", "analyses", "acme-coast", cwd=elsewhere, site=site)
    assert "analysis of acme-coast 0.1.0" in shown
    assert "speed (m/s)" in shown


def test_a_friction_law_passes_and_is_found(tmp_path: Path) -> None:
    made = rigd("new", "friction-law", "acme-rubber", "--folder", tmp_path, cwd=tmp_path)
    assert made.code == 0, made.err
    assert "rigd identify FILE --law acme-rubber" in made.out
    assert "device" not in made.out
    site = installed(tmp_path / "acme-rubber", tmp_path)
    assert (site / "acme_rubber" / "py.typed").is_file()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    tested = run(
        "pytest", "-q", "-p", "no:cacheprovider", tmp_path / "acme-rubber" / "tests",
        cwd=elsewhere, site=site,
    )  # fmt: skip
    assert "2 passed" in tested
    find = "from rigd.analysis.friction.registry import find_law; print(find_law('acme-rubber'))"
    (elsewhere / "find.py").write_text(find)
    assert "acme_rubber.law.AcmeRubber" in run("find", cwd=elsewhere, site=site)


def test_a_plant_installs_passes_its_tests_and_runs(tmp_path: Path) -> None:
    package = tmp_path / "acme-sled"
    made = rigd("new", "plant", "acme-sled", "--folder", tmp_path, cwd=tmp_path)
    assert made.code == 0, made.err
    assert f"--rig {package / 'rig.yaml'}" in made.out
    site = installed(package, tmp_path)
    assert (site / "acme_sled" / "parameters" / "acme-sled.yaml").is_file()
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    tested = run(
        "pytest", "-q", "-p", "no:cacheprovider", package / "tests", cwd=elsewhere, site=site
    )
    assert "passed" in tested

    shown = run("rigd", "drivers", "acme-sled", cwd=elsewhere, site=site)
    assert "plant of acme-sled 0.1.0" in shown
    assert "surface" in shown
    run(
        "rigd", "run", package / "push.yaml", "--rig", package / "rig.yaml",
        "--set", "surface=steel", "--yes", "--output", "push.mcap", cwd=elsewhere, site=site,
    )  # fmt: skip
    assert "acme-sled-1" in run("rigd", "info", "push.mcap", cwd=elsewhere, site=site)


def test_new_package_is_typed_and_formatted_like_rigd(
    tmp_path: Path, pytestconfig: pytest.Config
) -> None:
    for kind in MADE:
        for path, text in rendered(f"acme-{kind}", kind).items():
            file = tmp_path / f"acme-{kind}" / path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(text)
    config = ROOT / "pyproject.toml"
    run("ruff", "format", "--check", "--config", config, ".", cwd=tmp_path)
    for kind in MADE:  # in its folder, as its author would: its imports stand apart
        run("ruff", "check", "--config", config, ".", cwd=tmp_path / f"acme-{kind}")
    packages = [tmp_path / f"acme-{kind}" / module_name(f"acme-{kind}") for kind in MADE]
    cache = pytestconfig.cache
    assert cache is not None
    kept = cache.mkdir("mypy")  # what rigd imports takes 10 s; mypy itself sees what has changed
    run("mypy", "--strict", "--cache-dir", kept, *packages, cwd=tmp_path)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("Acme", "is not a valid name"),
        ("acme_scale", "is not a valid name"),
        ("2acme", "is not a valid name"),
        ("-acme", "is not a valid name"),
        ("acme-", "is not a valid name"),
        ("acme--scale", "is not a valid name"),
        ("acme/scale", "is not a valid name"),
        ("../acme", "is not a valid name"),
        ("", "is not a valid name"),
        ("acme\n", "is not a valid name"),
        ("a" * 41, "is not a valid name"),
        ("class", "a keyword of Python"),
        ("json", "package 'json' exists already"),
        ("rigd", "package 'rigd' exists already"),
        ("tests", "package 'tests' exists already"),
        ("rigd-drivers", "package 'rigd_drivers' exists already"),
        ("serial-scale", "a driver 'serial-scale' is installed"),
    ],
)
def test_invalid_package_name_is_refused_with_hint(name: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        check_name(name)
    assert words in caught.value.message
    assert caught.value.hint


def test_plant_name_is_compared_with_plants_only() -> None:
    check_name("serial-scale", "plant")
    with pytest.raises(ConfigError, match="a plant 'approach-angle' is installed"):
        check_name("approach-angle", "plant")


@pytest.mark.parametrize("kind", RETIRED)
def test_kind_without_template_names_what_to_read(kind: str, tmp_path: Path) -> None:
    refused = rigd("new", "driver", "acme", "--kind", kind, cwd=tmp_path)
    assert refused.code == 2
    assert RETIRED[kind] in refused.err
    assert "docs/drivers.md" in refused.err
    for module in re.findall(r"rigd[\w.]*\w", RETIRED[kind]):
        assert importlib.util.find_spec(module) is not None
    for driver in re.findall(r"driver: ([\w-]+)", RETIRED[kind]):
        assert entry_points(group="rigd.drivers", name=driver)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "acme").mkdir()
    refused = rigd("new", "driver", "acme", cwd=tmp_path)
    assert refused.code == 2
    assert "acme exists already" in refused.err
    assert list((tmp_path / "acme").iterdir()) == []
    (tmp_path / "other").symlink_to(tmp_path / "nowhere")
    assert rigd("new", "driver", "other", cwd=tmp_path).code == 2
    assert not (tmp_path / "nowhere").exists()


def test_missing_folder_or_bad_name_is_reported(tmp_path: Path) -> None:
    refused = rigd("new", "driver", "acme", "--folder", "absent", cwd=tmp_path)
    assert refused.code == 2
    assert "folder absent does not exist" in refused.err
    refused = rigd("new", "driver", "Acme", cwd=tmp_path)
    assert refused.code == 2
    assert "'Acme' is not a valid name" in refused.err
    assert list(tmp_path.iterdir()) == []
