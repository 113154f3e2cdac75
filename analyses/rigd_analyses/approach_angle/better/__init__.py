"""The better analysis of one run: slip-gated friction with every known drag taken off."""

from rigd_analyses.approach_angle.better.bending import Bending
from rigd_analyses.approach_angle.better.result import BetterRun, Blocks, Smoothed
from rigd_analyses.approach_angle.better.run import analyse_better
from rigd_analyses.approach_angle.better.settings import BetterSettings

__all__ = ["Bending", "BetterRun", "BetterSettings", "Blocks", "Smoothed", "analyse_better"]
