"""Proposes a map for files of another program, from what stands in them."""
