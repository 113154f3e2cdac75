"""The LuGre omni-wheel rig: slip and traction of a driven carriage to friction parameters."""

from rigd.identify.lugre.identify import Settings, identify_lugre
from rigd.identify.lugre.preprocess import Guards
from rigd.identify.lugre.trial import LugreConstants, LugreTrial

__all__ = ["Guards", "LugreConstants", "LugreTrial", "Settings", "identify_lugre"]
