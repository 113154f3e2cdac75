"""Mistakes in drivers of a fourth author, who saw neither the suite nor the other mistakes."""
