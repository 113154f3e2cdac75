"""Expressions: one grammar for procedures, derived channels, end conditions and searches."""
