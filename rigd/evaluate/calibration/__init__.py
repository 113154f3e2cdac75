"""Evaluation of recordings that calibrate a rig: torque, scale, friction, rise of the load."""

from rigd.evaluate.calibration.evaluation import CalibrationEvaluation, evaluate

__all__ = ["CalibrationEvaluation", "evaluate"]
