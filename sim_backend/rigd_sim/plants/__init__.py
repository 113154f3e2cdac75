"""Contains the physics of the simulated rigs, one folder for each rig."""
