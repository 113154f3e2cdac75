"""Recordings to arrays to an identification to a report."""

from rigd.evaluate.evaluation import Evaluation, Options, evaluate

__all__ = ["Evaluation", "Options", "evaluate"]
