"""A constant that the data move farther than chance does is named, if a result rests on it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rigd.analysis.gate import strained_gate
from rigd.analysis.output_error import OutputErrorFit
from rigd.analysis.result import FitOutcome, Gate
from rigd.analysis.strained import strained

from .lines import BLOCK, Lines, fitted

GAIN, OFFSET = 1, 2  #: places among the shared unknowns; stated to be 0 with the uncertainty 1
FITS = Gate(FitOutcome.FITS, "The model fits.")


def lines(offset: float) -> OutputErrorFit:
    made = Lines(((0, 6.0), (0, 5.0), (0, 4.0)), (0.7,))
    return fitted(replace(made, measured=tuple(y + offset for y in made.measured)))


def test_constant_moved_far_is_named_with_its_size() -> None:
    found = strained(lines(3.8), (GAIN, OFFSET), {}, BLOCK)
    assert found is not None
    assert (found.name, found.stated) == ("the offset", 0.0)
    assert found.size == pytest.approx(3.5, abs=0.05)
    assert found.pull == pytest.approx(3.5, abs=0.05)
    gate = strained_gate(FITS, found)
    assert gate.outcome is FitOutcome.MISFIT
    assert "another the offset: 3.497" in gate.sentence


def test_constant_moved_little_is_not_named() -> None:
    assert strained(lines(2.0), (GAIN, OFFSET), {}, BLOCK) is None
    assert strained_gate(FITS, None) is FITS


def test_constant_that_nothing_rests_on_is_not_tested() -> None:
    assert strained(lines(3.8), (GAIN,), {}, BLOCK) is None
