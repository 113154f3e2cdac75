"""Packages as `rigd new` or an author writes them, each with one mistake, for conformance suites.

A mutant is a replacement of text in a driver, a plant or an analysis, and names the rule of
``check_driver``, ``check_plant`` or ``check_analysis`` that finds it. ``benchmarks/conformance.py``
examines all of them, the test suite some.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from sdk.mutants.fresh import sensor
from support.written_drivers import written

from rigd.analysis.check import examine_analysis
from rigd.cli.plugins.new import module_name
from rigd.sdk import AnyDriver
from rigd.sdk.check import Report, examine_driver, examine_plant


@dataclass(frozen=True)
class Mutant:
    """One mistake: ``old`` becomes ``new`` in ``file`` of the package, wherever it occurs."""

    name: str
    #: The rule that finds it.
    rule: str
    old: str
    new: str
    file: str = "driver"

    def applied(self, text: str, class_name: str) -> str:
        """Return ``text`` with the mistake.

        Raises:
            ValueError: the text to replace is not there.
        """
        if self.old not in text:
            raise ValueError(f"{self.name}: the file does not contain {self.old!r}")
        return text.replace(self.old, self.new)


class Mistake(Protocol):
    """What :func:`made` puts into a package: a :class:`Mutant`, or one that names no rule."""

    @property
    def name(self) -> str: ...

    @property
    def file(self) -> str: ...

    def applied(self, text: str, class_name: str) -> str: ...


@dataclass(frozen=True)
class Package:
    """A package that was made: examines it by rules of the conformance suite; all, if none."""

    examine: Callable[[Collection[str]], Report]


def texts(kind: str, mutant: Mistake | None) -> tuple[str, str, dict[str, str]]:
    """Return the module of a package, the name of its class, and its files with the mistake.

    Raises:
        ValueError: the text to replace is not there.
    """
    word = "none" if mutant is None else re.sub(r"[^a-z0-9]+", "-", mutant.name)
    name = f"{kind}-with-{word}"
    module = module_name(name)
    class_name = "".join(part.capitalize() for part in name.split("-"))
    files = sensor.rendered(module, class_name) if kind == "sensor" else written(name, kind)
    if mutant is not None:
        path = f"{module}/{mutant.file}.py"
        files = {**files, path: mutant.applied(files[path], class_name)}
    return module, class_name, dict(files)


@contextmanager
def made(kind: str, mutant: Mistake | None, folder: Path) -> Iterator[Package]:
    """Write the package of a driver of ``kind`` into ``folder``, with the mistake, and import it.

    Raises:
        ValueError: the text to replace is not there.
    """
    module, class_name, files = texts(kind, mutant)
    for path, text in files.items():
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, "utf-8")
    sys.path.insert(0, str(folder))
    try:
        tests = f"test_{kind}" if kind in ("plant", "analysis") else "test_driver"
        spec = importlib.util.spec_from_file_location(
            f"{module}_{tests}", folder / "tests" / f"{tests}.py"
        )
        assert spec is not None
        assert spec.loader is not None
        read = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(read)
        yield Package(_EXAMINERS.get(kind, _driver)(read, module, class_name, folder))
    finally:
        sys.path.remove(str(folder))
        for loaded in [each for each in list(sys.modules) if each.split(".")[0] == module]:
            del sys.modules[loaded]


def _driver(tests: Any, module: str, name: str, folder: Path) -> Callable[..., Report]:
    driver: type[AnyDriver] = getattr(importlib.import_module(f"{module}.driver"), name)
    return lambda only: examine_driver(driver, peer=tests.simulated, only=only)


def _plant(tests: Any, module: str, name: str, folder: Path) -> Callable[..., Report]:
    kinds = {"motor": tests.Motor, "encoder": tests.Encoder, "truth": tests.Truth}
    devices: dict[str, tuple[type[Any], dict[str, Any]]] = {
        name: (driver, {}) for name, driver in kinds.items()
    }
    plant = getattr(tests, name)
    return lambda only: examine_plant(plant, devices=devices, truth="truth", only=only)


def _analysis(tests: Any, module: str, name: str, folder: Path) -> Callable[..., Report]:
    cases = [tests.case(3.0, 1.5), tests.case(3.0, 0.0, unknown=("viscous",))]
    recordings = folder / "recordings"
    recordings.mkdir()
    return lambda only: examine_analysis(
        getattr(tests, name), cases, recordings, only=only, drawn=tests.drawn
    )


_EXAMINERS = {"plant": _plant, "analysis": _analysis}
