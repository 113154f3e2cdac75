"""Renews the control lease of a client."""
