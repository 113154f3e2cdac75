"""The better analysis of one run: slip-gated friction with every known drag taken off."""

from rigd.identify.angle.better.bending import Bending
from rigd.identify.angle.better.result import BetterRun, Blocks, Smoothed
from rigd.identify.angle.better.run import analyse_better
from rigd.identify.angle.better.settings import BetterSettings

__all__ = ["Bending", "BetterRun", "BetterSettings", "Blocks", "Smoothed", "analyse_better"]
