"""Evaluation of recordings that calibrate a rig: torque, scale, friction of rails and bearings."""

from rigd.evaluate.calibration.evaluation import CalibrationEvaluation, evaluate

__all__ = ["CalibrationEvaluation", "evaluate"]
