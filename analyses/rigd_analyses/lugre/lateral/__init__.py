"""Identifies the friction of the passive rollers from drives during lateral motion.

See lugre.md section 2.
"""
