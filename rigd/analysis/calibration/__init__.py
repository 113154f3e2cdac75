"""Contains what the calibration of any rig needs: recordings by step, values with their budgets."""

from rigd.config.calibration.calibration import (
    ATTACHMENT,
    CalibratedValue,
    Calibration,
    load_calibration,
    parse_calibration,
)

__all__ = [
    "ATTACHMENT",
    "CalibratedValue",
    "Calibration",
    "load_calibration",
    "parse_calibration",
]
