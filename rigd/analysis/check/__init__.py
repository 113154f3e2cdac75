"""Checks that an analysis keeps its promises: a suite that an author calls in one line of pytest.

::

    def test_conforms(tmp_path: Path) -> None:
        check_analysis(CoastAnalysis, [simulated_case()], tmp_path)

A :class:`Case` holds trials that are simulated from known parameters, and the expected results. The
code of the simulation must not be code of the analysis.
"""

from rigd.analysis.check.case import Case, SimulatedTrial, write_case
from rigd.analysis.check.suite import check_analysis, examine_analysis, intervals_of

__all__ = [
    "Case",
    "SimulatedTrial",
    "check_analysis",
    "examine_analysis",
    "intervals_of",
    "write_case",
]
