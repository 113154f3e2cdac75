"""The LuGre omni-wheel rig: slip and traction of a driven carriage to friction parameters."""

from rigd.identify.lugre.trial import LugreConstants, LugreTrial

__all__ = ["LugreConstants", "LugreTrial"]
