"""Contains what the author of a friction law needs, and the model that fits one to slip and force.

A law is a class that entry points below ``rigd.friction_laws`` name (docs/friction_laws.md).
"""

from rigd.analysis.friction.compiled_law import gradient, step
from rigd.analysis.friction.law import FrictionLaw, LawParameter
from rigd.analysis.friction.model import LawModel, SlipForce

__all__ = ["FrictionLaw", "LawModel", "LawParameter", "SlipForce", "gradient", "step"]
