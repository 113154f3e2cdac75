"""Procedure files: read, checked, compiled to cycle programs."""
