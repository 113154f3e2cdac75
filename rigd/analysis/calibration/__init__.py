"""What the calibration of any rig needs: a recording by its steps, values with their budgets."""
