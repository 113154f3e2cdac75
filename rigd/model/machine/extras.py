"""Checks which extras of rigd are installed: libraries that only some commands need.

``pip install 'rigd[analysis]'`` installs an extra.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Final

from rigd.model.errors import Exit, RigdError

#: The modules of each extra; ``pyproject.toml`` has their versions.
MODULES: Final[Mapping[str, tuple[str, ...]]] = {
    "analysis": ("scipy", "matplotlib", "jinja2", "markupsafe"),
    "export": ("pyarrow", "h5py", "asammdf"),
    "panel": ("starlette", "uvicorn", "h11", "websockets"),
    "ni": ("nidaqmx", "grpc"),
    "foxglove": ("foxglove",),
    "fmu": ("fmpy",),
    "dbc": ("cantools",),
    "pymeasure": ("pymeasure", "pyvisa", "pyvisa_py"),
    "import": ("scipy", "pyarrow", "h5py", "nptdms", "asammdf"),
}


class MissingExtra(RigdError):
    """An extra of rigd is not installed; ``needed_by`` is the command or device that needs it."""

    exit_code = Exit.BAD_INPUT

    def __init__(self, needed_by: str, extra: str) -> None:
        super().__init__(missing(needed_by, extra))


def missing(needed_by: str, extra: str) -> str:
    """Return the problem and the remedy if ``extra`` is not installed."""
    return f"{needed_by} needs the extra \"{extra}\": pip install 'rigd[{extra}]'"


def is_installed(extra: str) -> bool:
    """Return whether every module of ``extra`` can be found; imports none."""
    return all(find_spec(module) is not None for module in MODULES[extra])


def require(extra: str, needed_by: str) -> None:
    """Do nothing if ``extra`` is installed.

    Raises:
        MissingExtra: it is not.
    """
    if not is_installed(extra):
        raise MissingExtra(needed_by, extra)
