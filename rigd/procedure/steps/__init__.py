"""Compiles the steps of a procedure."""
