"""Estimators of any model: fits, intervals, and what the residuals show."""
