"""Identifies the contacts of an articulated robot with slipping wheels (articulated.md)."""
