"""Contains the analysis of a swing that a relay makes: the gains of a controller."""
