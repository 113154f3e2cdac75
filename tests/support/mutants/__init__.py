"""Drivers as `rigd new driver` writes them, each with one mistake, for the conformance suite.

A mutant is a replacement of text in the driver or its protocol, and names the rule of
``check_driver`` that finds it. ``benchmarks/conformance.py`` examines all of them, the test suite
some.
"""

from __future__ import annotations

import importlib
import importlib.util
import re
import sys
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from rigd.cli.new import module_name, rendered
from rigd.sdk import AnyDriver
from rigd.sdk.check import Peer, Report, examine_driver


@dataclass(frozen=True)
class Mutant:
    """One mistake: ``old`` becomes ``new`` in ``file`` of the package, wherever it occurs."""

    name: str
    #: The rule that finds it.
    rule: str
    old: str
    new: str
    file: str = "driver"


@dataclass(frozen=True)
class Package:
    """A package that was made: its driver, and what starts its simulated device."""

    driver: type[AnyDriver]
    peer: Callable[[], AbstractContextManager[Peer]]

    def examine(self, only: Collection[str] = ()) -> Report:
        """Return the report of the conformance suite."""
        return examine_driver(self.driver, peer=self.peer, only=only)


@contextmanager
def made(kind: str, mutant: Mutant | None, folder: Path) -> Iterator[Package]:
    """Write the package of a driver of ``kind`` into ``folder``, with the mistake, and import it.

    Raises:
        ValueError: the text to replace is not there.
    """
    word = "none" if mutant is None else re.sub(r"[^a-z0-9]+", "-", mutant.name)
    name = f"{kind}-with-{word}"
    module = module_name(name)
    for path, text in rendered(name, kind).items():
        if mutant is not None and path == f"{module}/{mutant.file}.py":
            if mutant.old not in text:
                raise ValueError(f"{mutant.name}: {path} does not contain {mutant.old!r}")
            text = text.replace(mutant.old, mutant.new)
        target = folder / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text, "utf-8")
    sys.path.insert(0, str(folder))
    try:
        spec = importlib.util.spec_from_file_location(
            f"{module}_test_driver", folder / "tests" / "test_driver.py"
        )
        assert spec is not None
        assert spec.loader is not None
        tests = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(tests)
        driver = importlib.import_module(f"{module}.driver")
        class_name = "".join(part.capitalize() for part in name.split("-"))
        yield Package(getattr(driver, class_name), tests.simulated)
    finally:
        sys.path.remove(str(folder))
        for loaded in [each for each in sys.modules if each.split(".")[0] == module]:
            del sys.modules[loaded]
