"""The site that `make docs` builds: reference made from the code, pages that link, a search."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
from support.panel.browser import chromium

from rigd.cli.main import COMMANDS, command_name
from rigd.cli.plugins.inventory import GROUPS

DOCS = Path(__file__).resolve().parents[2] / "docs"
SCHEMAS = DOCS.parent / "schemas"


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages of the reference, made from the code."""
    spec = importlib.util.spec_from_file_location("reference_pages", DOCS / "reference_pages.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    folder = tmp_path_factory.mktemp("reference")
    (folder / "removed.md").write_text("of a version before", "utf-8")
    module.write(folder, SCHEMAS)
    return folder


def test_every_command_has_its_help(reference: Path) -> None:
    page = (reference / "commands.md").read_text("utf-8")
    for command in COMMANDS:
        name = command_name(command)
        assert f"\n## rigd {name}\n\n```text\nusage: rigd {name}" in page
    assert "\n### rigd remote start\n\n```text\nusage: rigd remote start" in page


def test_every_plugin_is_described(reference: Path) -> None:
    page = (reference / "plugins.md").read_text("utf-8")
    for group, kind in GROUPS.items():
        for point in entry_points(group=group):
            assert f"\n({kind.name}-{point.name})=\n### {point.name}\n" in page
    assert "| `dialect` | mt-sics or kern-kcp" in page


def test_links_to_the_reference_lead_somewhere(reference: Path) -> None:
    linked = {
        name
        for page in DOCS.glob("*.md")
        for name in re.findall(r"\]\(reference/([^)#]+)", page.read_text("utf-8"))
    }
    assert "python.md" in linked
    assert linked <= {page.name for page in reference.glob("*.md")}


@pytest.mark.parametrize("name", ["procedure", "rig", "calibration", "map"])
def test_every_key_of_a_file_is_explained(reference: Path, name: str) -> None:
    page = (reference / f"{name}_file.md").read_text("utf-8")
    schema = json.loads((SCHEMAS / f"{name}.schema.json").read_text("utf-8"))
    for part in (schema, *schema["$defs"].values()):
        for key, what in part.get("properties", {}).items():
            meaning = " ".join(what.get("description", "").split()).replace("|", "\\|")
            assert any(
                row.startswith(f"| `{key}` |") and row.endswith(f"| {meaning} |")
                for row in page.splitlines()
            )


def test_pages_of_former_versions_are_removed(reference: Path) -> None:
    assert not (reference / "removed.md").exists()


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole site; a page without a place and a link that leads nowhere fail the build."""
    folder = tmp_path_factory.mktemp("site")
    build = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", str(DOCS), str(folder)]
    done = subprocess.run(build, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def page() -> Iterator[Any]:
    with chromium() as browser:
        yield browser.new_page()


def test_search_from_the_disk_finds_a_key(site: Path, page: Any) -> None:
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((site / "index.html").as_uri())
    page.fill("input.sidebar-search", "stale_after")
    page.keyboard.press("Enter")
    page.wait_for_selector("#search-results a:has-text('Rig files')")
    page.click("#search-results a:has-text('Rig file: every key')")
    page.wait_for_selector("h1:has-text('Rig file')")
    assert all(url.startswith(("file:", "data:")) for url in asked)  # nothing from the network
