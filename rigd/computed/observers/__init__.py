"""Observers: filters that estimate what is not measured, in the cycle, from what is."""
