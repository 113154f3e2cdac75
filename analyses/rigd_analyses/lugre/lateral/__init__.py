"""Friction of the passive rollers, from drives during lateral motion (lugre.md section 2)."""
