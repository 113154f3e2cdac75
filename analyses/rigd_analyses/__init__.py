"""Analyses of rig families that come with rigd: recordings in, friction with uncertainties out."""
