"""Models the whole rig: motor current in; wheel, carriage and acceleration out."""
