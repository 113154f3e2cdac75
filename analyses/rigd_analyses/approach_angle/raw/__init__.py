"""Reads the raw run of a trial: its signals, what is known of the rig, and faults in its data."""
