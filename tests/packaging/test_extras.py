"""Without extras rigd drives, records and serves; a command that needs one names it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from support.daemon.process import listening
from support.daemon.served_rig import free_port

from rigd.model.errors import Exit
from rigd.model.machine.extras import MODULES, MissingExtra, is_installed, require

ROOT = Path(__file__).parents[2]
RIG = ROOT / "configs" / "sim_lugre.yaml"
#: What every process does first that is started here, and by what is started here.
HIDE = f"import sys\nsys.modules.update(dict.fromkeys({sorted(sum(MODULES.values(), ()))}))\n"
TIMEOUT_S = 240


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, str]:
    """Return an environment in which no module of an extra can be imported."""
    folder = tmp_path_factory.mktemp("bare")
    (folder / "sitecustomize.py").write_text(HIDE)
    state = tmp_path_factory.mktemp("state")
    return {**os.environ, "PYTHONPATH": str(folder), "RIGD_STATE": str(state)}


def rigd(
    bare: Mapping[str, str], cwd: Path, *arguments: str | Path
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "rigd", *map(str, arguments)],
        cwd=cwd,
        env=bare,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )


@pytest.fixture(scope="module")
def folder(bare: Mapping[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the recording of a run on a simulated rig, ``quick.mcap``."""
    folder = tmp_path_factory.mktemp("runs")
    done = rigd(bare, folder, "run", "quick", "--rig", RIG, "--output", "quick.mcap", "--quiet")
    assert done.returncode == Exit.OK, done.stderr
    return folder


@pytest.mark.parametrize("module", ["scipy", "starlette", "nidaqmx", "foxglove"])
def test_module_of_an_extra_is_hidden(bare: Mapping[str, str], module: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", f"import {module}"], env=bare, capture_output=True, check=False
    )
    assert b"ModuleNotFoundError" in done.stderr


@pytest.mark.parametrize(
    "command",
    [
        f"check {RIG}",
        f"check constant_current --rig {RIG}",
        f"run constant_current --rig {RIG} --dry-run",
        "info quick.mcap",
        "verify quick.mcap",
        "doctor",
        "drivers",
        "analyses lugre",
        "new analysis acme-coast",
    ],
)
def test_command_without_extras_succeeds(
    bare: Mapping[str, str], folder: Path, command: str
) -> None:
    done = rigd(bare, folder, *command.split())
    assert done.returncode == Exit.OK, done.stdout + done.stderr


def test_recover_without_extras_repairs_the_file(
    bare: Mapping[str, str], folder: Path, tmp_path: Path
) -> None:
    cut = tmp_path / "cut.mcap"
    shutil.copy(folder / "quick.mcap", cut)
    os.truncate(cut, cut.stat().st_size * 2 // 3)
    assert rigd(bare, tmp_path, "verify", cut).returncode == Exit.BAD_DATA
    done = rigd(bare, tmp_path, "recover", cut)
    assert done.returncode == Exit.OK, done.stderr
    assert rigd(bare, tmp_path, "verify", cut).returncode == Exit.OK


def test_daemon_without_extras_serves_without_a_panel(
    bare: Mapping[str, str], tmp_path: Path
) -> None:
    rig = tmp_path / "rig.yaml"
    shutil.copytree(RIG.parent / "plants", tmp_path / "plants")
    shutil.copy(RIG, rig)
    endpoint = listening(rig, free_port())
    with subprocess.Popen(
        [sys.executable, "-m", "rigd", "serve", "--rig", rig],
        cwd=tmp_path,
        env=bare,
        stdout=subprocess.PIPE,
        text=True,
    ) as daemon:
        assert daemon.stdout is not None
        lines = []
        for line in daemon.stdout:
            lines.append(line)
            if endpoint in line:
                break
        daemon.send_signal(signal.SIGTERM)
        assert daemon.wait(TIMEOUT_S) == Exit.OK
    assert any('"panel"' in line for line in lines)


@pytest.mark.parametrize(
    ("command", "extra"),
    [
        ("identify quick.mcap", "analysis"),
        ("report quick.mcap", "analysis"),
        ("export quick.mcap --to mat", "analysis"),
        ("calibrate calibrate_torque --rig angle-1 --operator me", "analysis"),
        ("panel", "panel"),
        (f"serve --rig {RIG} --panel", "panel"),
        (f"serve --rig {RIG} --no-panel --foxglove", "foxglove"),
        ("sim angle-wire-1", "ni"),
    ],
)
def test_command_names_the_missing_extra(
    bare: Mapping[str, str], folder: Path, command: str, extra: str
) -> None:
    before = sorted(folder.glob("*.*"))
    done = rigd(bare, folder, *command.split())
    assert done.returncode == Exit.BAD_INPUT, done.stderr
    *first, line = done.stderr.splitlines()
    assert all(text.startswith("rig ") for text in first)  # which rig file it took
    assert line.endswith(f"needs the extra \"{extra}\": pip install 'rigd[{extra}]'")
    assert sorted(folder.glob("*.*")) == before


def test_installed_extra_is_not_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    assert is_installed("analysis")
    require("analysis", "this test")
    monkeypatch.setitem(sys.modules, "scipy", None)
    with pytest.raises(MissingExtra, match="analysis"):
        require("analysis", "this test")


def test_page_of_installation_lists_every_extra() -> None:
    page = (ROOT / "docs" / "install.md").read_text("utf-8")
    assert [extra for extra in MODULES if f"| `{extra}` |" not in page] == []
