"""Evaluation of the approach-angle rig: recordings of one campaign to its report."""
