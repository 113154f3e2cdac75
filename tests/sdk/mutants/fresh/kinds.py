"""The fresh mutants of each author, by kind of package."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Final

from sdk.mutants.fresh import Fresh

#: Where the mutants of each author are, in a module for each kind.
_PACKAGES: Final = {
    "first": "sdk.mutants.fresh",
    "second": "sdk.mutants.fresh.second",
    "third": "sdk.mutants.fresh.third",
    "fourth": "sdk.mutants.fresh.fourth",
}
_MODULES: Final = {
    "fast": "fast",
    "scpi": "scpi",
    "sensor": "sensors",
    "slow": "slow",
    "serial": "serial",
    "block": "block",
    "plant": "plant",
    "analysis": "analysis",
}

#: Kinds of which an author wrote none: the fourth wrote drivers only.
_WITHOUT: Final = {"fourth": ("plant", "analysis")}

#: By author, then by kind.
AUTHORS: Mapping[str, Mapping[str, Sequence[Fresh]]] = {
    author: {
        kind: import_module(f"{package}.{name}").MUTANTS
        for kind, name in _MODULES.items()
        if kind not in _WITHOUT.get(author, ())
    }
    for author, package in _PACKAGES.items()
}
