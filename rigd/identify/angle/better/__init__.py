"""The better analysis of one run: slip-gated friction with every known drag taken off."""

from rigd.identify.angle.better.result import BetterRun, Blocks, Smoothed

__all__ = ["BetterRun", "Blocks", "Smoothed"]
