"""Physics of the simulated rigs, one folder a rig."""
