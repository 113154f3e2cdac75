"""Checks whether this machine and a rig are fit for a run (``rigd doctor``).

Every result is measured.
"""

from rigd.daemon.doctor.check import Check, CheckVerdict, is_fit
from rigd.daemon.doctor.examine import Examination, examine

__all__ = ["Check", "CheckVerdict", "Examination", "examine", "is_fit"]
