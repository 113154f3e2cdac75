"""One thing that is wrong at a rig, and the words that count as its right name."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

World = TypeVar("World")


@dataclass(frozen=True)
class Kind(Generic[World]):
    """One thing that is wrong: how, its two sizes (just visible, clearly visible), its words."""

    name: str
    family: str
    sizes: tuple[float, ...]
    words: str
    apply: Callable[[World, float, np.random.Generator], None]
    documented: bool = False  # the docs say that no data of the rig show it

    def accepts(self, sentence: str) -> bool:
        """Return whether a sentence has one of the words."""
        if self.family == "friction" and sentence.lower().startswith("an error of the"):
            return False  # a sensor
        return re.search(self.words, sentence.lower()) is not None
