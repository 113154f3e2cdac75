"""What is installed: the wheel holds the packages, the shipped files and the licence, and runs."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [
            sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation",
            "--disable-pip-version-check", "--wheel-dir", str(folder), str(ROOT),
        ],
        check=True,
    )  # fmt: skip
    (path,) = folder.glob("rigd-*.whl")
    return path


def test_wheel_contains_exactly_the_needed_files(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {
        "rigd/cli/main.py",
        "rigd/py.typed",
        "rigd_sim/lugre/kernel.py",
        "rigd_drivers/__init__.py",
        "rigd/_bundled/procedures/constant_current.yaml",
        "rigd/_bundled/configs/sim_lugre.yaml",
        "rigd/_bundled/configs/plants/lugre.yaml",
        "rigd/_bundled/configs/eds/rigd_servo.eds",
        "rigd/_bundled/maps/lugre_tables.yaml",
        "rigd/_bundled/schemas/procedure.schema.json",
        "rigd/analysis/report/templates/report.css",
        "rigd/cli/templates/analysis/MODULE/analysis.py.jinja",
        "rigd_analyses/approach_angle/report/templates/campaign.html.jinja",
    } <= names
    tops = {name.partition("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {
        "rigd", "rigd_analyses", "rigd_drivers", "rigd_sim",
    }  # fmt: skip
    assert any(name.endswith("licenses/LICENSE") for name in names)


def test_wheel_is_for_every_system(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    (about,) = (name for name in archive.namelist() if name.endswith(".dist-info/WHEEL"))
    lines = archive.read(about).decode().splitlines()
    assert wheel.name.endswith("-py3-none-any.whl")
    assert "Root-Is-Purelib: true" in lines
    assert [line for line in lines if line.startswith("Tag")] == ["Tag: py3-none-any"]
    assert not [name for name in archive.namelist() if name.endswith((".so", ".pyd", ".dylib"))]


def test_the_installed_wheel_runs_from_any_folder(wheel: Path, tmp_path: Path) -> None:
    site = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(site)
    script = (
        f"import sys; sys.path.insert(0, {str(site)!r})\n"
        "import rigd; assert rigd.__file__.startswith(sys.path[0]), rigd.__file__\n"
        "from rigd.cli.main import main\n"
        "sys.exit(main(['run', 'quick', '--rig', 'lugre-1', '--quiet', '--output', 'q.mcap']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "q.mcap").stat().st_size > 100_000


def test_no_package_file_makes_folders_importable_as_packages() -> None:
    for folder in ("analyses", "drivers", "sim_backend", "tests", "procedures", "configs", "maps"):
        assert not (ROOT / folder / "__init__.py").exists(), folder
