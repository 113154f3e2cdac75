"""Evaluation of the approach-angle rig: the recordings of one campaign to its report."""

from rigd.evaluate.angle.evaluation import CampaignEvaluation, evaluate

__all__ = ["CampaignEvaluation", "evaluate"]
