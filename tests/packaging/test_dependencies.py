"""What pyproject.toml requires is what the code imports: nothing missing, nothing dead."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions, requires
from pathlib import Path
from typing import Final

import pytest
from packaging.requirements import Requirement

from rigd.model.machine.extras import MODULES

ROOT = Path(__file__).parents[2]
PRODUCT = [
    ROOT / part
    for part in ("rigd", "analyses/rigd_analyses", "drivers/rigd_drivers", "sim_backend/rigd_sim")
]
OURS = {
    *("rigd", "rigd_analyses", "rigd_drivers", "rigd_sim"),
    *("rigd_pendulum", "support", "contract", "sdk", "conftest"),
}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
#: What another library loads by its name, with the words of our code that make it do so.
LOADED: Final = {
    "websockets": ("rigd/panel/server.py", 'ws="websockets-sansio"'),  # by uvicorn
    # By PyVISA.
    "pyvisa-py": ("drivers/rigd_drivers/instruments/pymeasure_bridge/config.py", "`@py`"),
}


def spelt(name: str) -> str:
    """Return the name of a distribution as indexes compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def named(requirements: list[str]) -> set[str]:
    """Return the distributions of ``requirements``."""
    return {spelt(Requirement(each).name) for each in requirements}


def brought(requirements: list[str]) -> set[str]:
    """Return the distributions that come by the extras of ``requirements``, as in ``a[b]``."""
    return {
        spelt(needed.name)
        for requirement in map(Requirement, requirements)
        for extra in requirement.extras - {*EXTRAS}
        for needed in map(Requirement, requires(requirement.name) or ())
        if needed.marker is not None
        and needed.marker.evaluate({"extra": extra})
        and not needed.marker.evaluate({"extra": ""})
    }


EXTRAS: Final[dict[str, list[str]]] = PROJECT["optional-dependencies"]
NEEDED = named(PROJECT["dependencies"])
#: The extras of the product, ``all`` and ``dev`` aside: what each brings.
BROUGHT: Final = {extra: named(EXTRAS[extra]) for extra in MODULES}
DECLARED: Final = NEEDED.union(*BROUGHT.values())


class Imports(ast.NodeVisitor):
    """The top-level modules that a file imports, and of these what it can do without."""

    def __init__(self) -> None:
        self.found: set[str] = set()
        self.optional: set[str] = set()

    def visit_Import(self, node: ast.Import) -> None:
        self.found |= {each.name.partition(".")[0] for each in node.names}

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        if node.module is not None and not node.level:
            self.found.add(node.module.partition(".")[0])

    def visit_Call(self, node: ast.Call) -> None:
        """Take ``pytest.importorskip("x")`` and ``import_module("x")`` for imports."""
        called = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if called in ("importorskip", "import_module") and node.args:
            (name,) = node.args[:1]
            if isinstance(name, ast.Constant) and isinstance(name.value, str):
                self.found.add(name.value.partition(".")[0])
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        """Leave out what types alone need."""
        if "TYPE_CHECKING" not in ast.unparse(node.test):
            self.generic_visit(node)

    def visit_Try(self, node: ast.Try) -> None:
        """Take what may be missing for optional."""
        before = set(self.found)
        self.generic_visit(node)
        if "ImportError" in "".join(ast.unparse(each) for each in node.handlers):
            self.optional |= self.found - before


@cache
def imports(folders: tuple[Path, ...]) -> tuple[dict[str, str], frozenset[str]]:
    """Return the distributions imported below ``folders``, each with a file, and the optional."""
    known = packages_distributions()
    found: dict[str, str] = {}
    optional: set[str] = set()
    for path in (path for folder in folders for path in sorted(folder.rglob("*.py"))):
        visitor = Imports()
        visitor.visit(ast.parse(path.read_text("utf-8")))
        for module in visitor.found - OURS - set(sys.stdlib_module_names):
            names = {spelt(name) for name in known.get(module, [module])}
            names = names & DECLARED or names  # others may share a namespace, such as ruamel
            found |= {name: str(path.relative_to(ROOT)) for name in names}
            if module in visitor.optional:
                optional |= names
    return found, frozenset(optional)


def undeclared(folders: list[Path], extras: tuple[str, ...]) -> list[str]:
    """Return what is imported below ``folders`` and not installed with ``extras``."""
    listed = [*PROJECT["dependencies"], *(each for extra in extras for each in EXTRAS[extra])]
    installed = named(listed) | brought(listed)
    found, optional = imports(tuple(folders))
    return [
        f"{path} imports {name}" for name, path in found.items() if name not in installed | optional
    ]


def test_the_product_imports_what_is_declared() -> None:
    assert undeclared(PRODUCT, tuple(MODULES)) == []


def test_tests_and_benches_import_what_is_declared() -> None:
    folders = [ROOT / "tests", ROOT / "benchmarks"]
    peers = {"deimos", "mujoco"}  # compared with, in an environment of their own or if installed
    local = {spelt(path.stem) for path in (ROOT / "benchmarks").iterdir()}
    told = undeclared(folders, (*MODULES, "dev"))
    assert [each for each in told if each.rpartition(" ")[2] not in local | peers] == []


@pytest.mark.parametrize("name", sorted(DECLARED))
def test_declared_dependency_is_imported(name: str) -> None:
    found, _ = imports(tuple(PRODUCT))
    if name in LOADED:
        path, words = LOADED[name]
        assert words in (ROOT / path).read_text("utf-8")
    else:
        assert name in found, "no code imports it: it is no dependency"


@pytest.mark.parametrize("extra", sorted(BROUGHT))
def test_extra_brings_the_modules_that_commands_name(extra: str) -> None:
    known = packages_distributions()
    listed = {spelt(name) for module in MODULES[extra] for name in known[module]}
    assert listed == BROUGHT[extra] | brought(EXTRAS[extra]) & listed
    assert not listed & NEEDED, "what everybody has is no extra"


def test_extras_of_the_project_are_known() -> None:
    assert {*EXTRAS} == {*MODULES, "all", "dev"}
    assert Requirement(*EXTRAS["all"]).extras == {*MODULES}
    assert "rigd[all]" in EXTRAS["dev"]
