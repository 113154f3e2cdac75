"""rigd: controller and data-acquisition daemon for friction and traction test rigs.

In a notebook::

    import rigd

    recording = rigd.open("runs/pvc.mcap")
    frame = recording.trial(3)["carriage"].to_pandas()
    result = rigd.identify([recording])

``import rigd`` loads nothing else: each name is imported when it is used first.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from rigd.analysis.api import Result, identify
    from rigd.analysis.compare.api import ComparisonResult, compare
    from rigd.analysis.estimates import Estimate
    from rigd.daemon.run_request import run
    from rigd.record import Recording, Table, Trial, Trials
    from rigd.record.read.reader import open_recording as open

__version__ = "0.2.0"

__all__ = [
    "ComparisonResult",
    "Estimate",
    "Recording",
    "Result",
    "Table",
    "Trial",
    "Trials",
    "compare",
    "identify",
    "open",
    "run",
]

#: The module of each name, and its name there.
_PLACES: Final = {
    "ComparisonResult": ("rigd.analysis.compare.api", "ComparisonResult"),
    "Estimate": ("rigd.analysis.estimates", "Estimate"),
    "Recording": ("rigd.record", "Recording"),
    "Result": ("rigd.analysis.api", "Result"),
    "Table": ("rigd.record", "Table"),
    "Trial": ("rigd.record", "Trial"),
    "Trials": ("rigd.record", "Trials"),
    "compare": ("rigd.analysis.compare.api", "compare"),
    "identify": ("rigd.analysis.api", "identify"),
    "open": ("rigd.record.read.reader", "open_recording"),
    "run": ("rigd.daemon.run_request", "run"),
}


if not TYPE_CHECKING:  # else every name would be there for mypy

    def __getattr__(name: str) -> Any:
        """Import a name when it is used first."""
        if name not in _PLACES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module, there = _PLACES[name]
        found = getattr(import_module(module), there)
        globals()[name] = found
        return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
