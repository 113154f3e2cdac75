"""Arrays in, parameters with uncertainties out."""
