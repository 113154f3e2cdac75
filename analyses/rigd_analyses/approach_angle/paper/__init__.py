"""The paper's analysis exactly: from the raw volts of one run to T/(R N) and the slip.

Misprints of the paper are corrected (each at its line) and what it leaves open is a setting with
the value that our golden results use; nothing else is improved here.
"""

from rigd_analyses.approach_angle.paper.pipeline import analyse_paper
from rigd_analyses.approach_angle.paper.result import PaperCurves, PaperRun
from rigd_analyses.approach_angle.paper.settings import Ends, PaperSettings

__all__ = ["Ends", "PaperCurves", "PaperRun", "PaperSettings", "analyse_paper"]
