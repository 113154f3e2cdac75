"""Runs the compiled filter of slip on the memory of an observer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from rigd.analysis.kernel import kernel
from rigd.computed.observers import kernel as shared
from rigd.computed.observers.memory import Memory
from rigd_analyses.lugre.rig import kernel as physics
from rigd_analyses.lugre.slip import kernel as own


def _entry(stamps: tuple[int, ...]) -> Callable[..., None]:
    """Return the compiled step.

    numba's cache notices changes in the file of the entry point alone, and in what the entry point
    encloses: ``stamps`` are the times of change of all files with compiled code, of which those
    that call other files are stored with the entry point alone (``part``).
    """

    @kernel
    def step(t_ns: int, words: Any, times: Any, floats: Any, places: Any, packed: Any) -> None:
        if stamps[0] != 0:
            own.step_slip(t_ns, words, times, floats, places, packed)

    return step


def _changed(module: ModuleType) -> int:
    return Path(str(module.__file__)).stat().st_mtime_ns


_step = _entry((_changed(own), _changed(physics), _changed(shared)))


class SlipFilter:
    """A filter of slip with its state; the numbers are those of its plan."""

    def __init__(
        self,
        memory: Memory,
        q: Sequence[float],
        fixed: Sequence[float],
        deviations: Sequence[float],
        noise: Sequence[float],
    ) -> None:
        n = len(deviations)
        self._tables = memory.join(
            (
                np.zeros(n), np.zeros((n, n)), np.zeros(2), np.zeros((n, n)), np.zeros(3),
                np.array(q), np.array(fixed), np.diag(np.array(noise) ** 2),
                np.zeros(n), np.diag(np.array(deviations) ** 2), np.zeros((n, n)),
                np.eye(2, n), np.zeros((n, n)), np.ones(n), np.zeros(physics.COUNT),
                np.zeros((4, 3)), np.zeros((4, 3, 3)), np.zeros((4, 3, physics.COUNT)),
                np.zeros((4, 3, n)), np.zeros(3), np.zeros((3, 3)),
            )
        )  # fmt: skip
        self._packed = memory.packed

    def step(self, t_ns: int, words: Any) -> None:
        """Compute the cycle at ``t_ns``."""
        _step(t_ns, words, *self._tables, self._packed)
