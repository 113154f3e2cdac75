"""Evaluates one run exactly by the paper's method: from raw volts to T/(R N) and the slip.

The code corrects misprints of the paper (each at its line). If the paper leaves something open, a
setting decides, with the value that our golden results use. Nothing else is improved here.
"""

from rigd_analyses.approach_angle.paper.pipeline import analyse_paper
from rigd_analyses.approach_angle.paper.result import PaperCurves, PaperRun
from rigd_analyses.approach_angle.paper.settings import Ends, PaperSettings

__all__ = ["Ends", "PaperCurves", "PaperRun", "PaperSettings", "analyse_paper"]
