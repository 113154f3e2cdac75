"""A kernel that is compiled is announced; one that lies on disk already is not."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from types import ModuleType

import pytest

from rigd.cli.main import COMPILING, main
from rigd.model.machine import compiling

KERNELS = """
from rigd.model.machine.kernel import kernel

@kernel
def double(number: float) -> float:
    return 2.0 * number

@kernel
def half(number: float) -> float:
    return 0.5 * number
"""


class Terminal(StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def nothing_waits() -> Iterator[None]:
    yield
    compiling.announce_once(lambda: None)


def loaded(file: Path) -> ModuleType:
    """Return the module of a file, as a process has it that starts anew."""
    spec = importlib.util.spec_from_file_location("some_kernels", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_kernels_are_announced_once_when_compiled(tmp_path: Path) -> None:
    file = tmp_path / "some_kernels.py"
    file.write_text(KERNELS, "utf-8")
    shown: list[str] = []
    compiling.announce_once(lambda: shown.append("first start"))
    first = loaded(file)
    assert (first.double(2.0), first.half(2.0), shown) == (4.0, 1.0, ["first start"])
    compiling.announce_once(lambda: shown.append("second start"))
    second = loaded(file)
    assert (second.double(3.0), second.half(3.0), shown) == (6.0, 1.5, ["first start"])


@pytest.mark.parametrize("stream", [Terminal(), StringIO()])
def test_terminal_and_pipe_show_the_line_once(
    stream: StringIO, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", stream)
    assert main(["schema", "rig"]) == 0
    for _ in range(2):
        compiling.begins()
    assert stream.getvalue() == f"{COMPILING}\n"
