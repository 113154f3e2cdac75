"""Calibration measurements to calibrated values with standard uncertainties, or to a refusal."""
