"""Computes setpoints over time, and defines how a procedure file states them."""
