"""Does an analysis keep its promises? A suite that any author runs in one line of pytest.

::

    def test_conforms(tmp_path: Path) -> None:
        check_analysis(CoastAnalysis, [simulated_case()], tmp_path)

A :class:`Case` holds trials simulated from known parameters, by code that the analysis does not
share, and what must come of them.
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
