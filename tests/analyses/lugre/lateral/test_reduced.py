"""The coupling from the friction of the guide in each trial: all optima, what the data allow."""

from __future__ import annotations

from support.lateral_wrong import right

from rigd.analysis.result import FitOutcome
from rigd_analyses.lugre.lateral.identify import find_lateral
from rigd_analyses.lugre.lateral.result import result


def test_either_law_is_held_by_intervals() -> None:
    # Rig 13: both laws of a lifted row fit, with mu_R_dry 0.040 and 0.051; 0.046 is true.
    sweep = right(13)
    found = find_lateral(sweep.trials(), sweep.rig, sweep.constants)
    assert found.gate.outcome is FitOutcome.FITS
    assert not found.rows_known
    shown = result(found)
    for name, value in sweep.truth.items():
        entry = shown.parameter(name)
        assert entry.low is not None and entry.high is not None, name
        assert entry.low <= value <= entry.high, name
