"""A rig family that rigd does not know: a pendulum with Coulomb and viscous friction."""
