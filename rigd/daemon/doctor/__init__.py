"""Is this machine, and this rig, fit to run? Every answer is measured, and says what to do."""

from rigd.daemon.doctor.check import Check, Verdict, is_fit
from rigd.daemon.doctor.examine import Examination, examine

__all__ = ["Check", "Examination", "Verdict", "examine", "is_fit"]
