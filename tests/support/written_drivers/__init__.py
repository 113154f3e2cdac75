"""Drivers as authors write them, beside those of `rigd new`: a card, a serial line, SCPI.

Each folder has the templates of a package: the driver, a simulated device that shares no code with
it, and its peer for the conformance suite.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from rigd.cli.plugins.new import filled, rendered

KINDS: Final = ("block", "serial", "scpi")


def written(name: str, kind: str) -> Mapping[str, str]:
    """Return the files of package ``name`` by path; of other kinds, those of `rigd new`."""
    if kind not in KINDS:
        return rendered(name, kind)
    slow = rendered(name, "slow")  # a serial line has its protocol
    return {**slow, **filled(Path(__file__).parent / kind, name, kind)}


def supply_class() -> Any:
    """Return the class of the simulated supply with SCPI."""
    module = ModuleType("supply")
    exec(written("acme-supply", "scpi")["acme_supply/simulated.py"], module.__dict__)
    return module.__dict__["Simulated"]
