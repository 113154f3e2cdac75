"""The posterior of the parameters of a fit: draws, and what they show."""
