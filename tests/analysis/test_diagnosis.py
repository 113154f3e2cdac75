"""Checks the search for explanations on a small system; the rig's own: analyses/lugre."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from rigd.analysis.diagnosis import Diagnosis, diagnose
from rigd.analysis.result import FloatArray
from rigd.analysis.score import Columns
from rigd.analysis.structure import Suspect

from .lines import BLOCK, ROWS, Lines, fitted

WAVE = np.sin(9.0 * np.linspace(0.0, 1.0, ROWS))


def diagnosed(shapes: tuple[int, int]) -> Diagnosis:
    """Diagnose lines with a wave on them that is suspected.

    The suspect has as many shapes as the first of ``shapes``, once the motion is refitted as many
    as the second.
    """
    lines = Lines(((0, 6.0), (0, 5.0), (0, 4.0)), (0.7,))
    lines = replace(lines, measured=tuple(y + 0.4 * WAVE[:, None] for y in lines.measured))
    whole = fitted(lines)
    first = whole.fit.theta.copy()

    def columns(count: int) -> Columns:
        return [WAVE[:, None, None] ** np.arange(1, count + 1) for _ in lines.trials]

    def suspects(theta: FloatArray) -> Iterator[Suspect]:
        count = shapes[0] if np.array_equal(theta, first) else shapes[1]
        yield Suspect("a wave", "1", lambda: columns(count), special=True)

    return diagnose(whole, suspects, [np.zeros(len(lines.shared))], BLOCK, 1e-3)


def test_explanation_is_fitted_with_its_size() -> None:
    (wave,) = diagnosed((1, 1)).explanations
    assert wave.name == "a wave"
    assert wave.size == pytest.approx(0.4, abs=0.02)


def test_explanation_with_other_shapes_when_refitted_is_left() -> None:
    diagnosis = diagnosed((1, 2))
    assert diagnosis.explanations == ()
    assert diagnosis.left[0].name == "a wave"


def test_explanation_that_cannot_be_fitted_yields_to_another() -> None:
    """By the score tests a twin explains most; with the motion refitted it has two shapes."""
    lines = Lines(((0, 6.0), (0, 5.0), (0, 4.0)), (0.7,))
    lines = replace(lines, measured=tuple(y + 0.4 * WAVE[:, None] for y in lines.measured))
    whole = fitted(lines)
    first = whole.fit.theta.copy()

    def alike(*waves: FloatArray) -> Columns:
        return [np.stack(waves, axis=1)[:, None, :] for _ in lines.trials]

    def suspects(theta: FloatArray) -> Iterator[Suspect]:
        twin = (WAVE,) if np.array_equal(theta, first) else (WAVE, WAVE**2)
        yield Suspect("a twin", "1", lambda: alike(*twin), special=True)
        yield Suspect("a wave", "1", lambda: alike(WAVE + 0.05 * np.roll(WAVE, 7)), special=True)

    diagnosis = diagnose(whole, suspects, [np.zeros(len(lines.shared))], BLOCK, 1e-3)
    (wave,) = diagnosis.explanations
    assert wave.name == "a wave"
    assert wave.others == ("a twin",)
