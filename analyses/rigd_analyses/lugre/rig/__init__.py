"""The whole rig as a model: motor current in; wheel, carriage and acceleration out."""
