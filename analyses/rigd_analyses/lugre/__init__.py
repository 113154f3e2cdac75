"""Computes the parameters of the LuGre friction model for an omni-wheel that drives a carriage."""
