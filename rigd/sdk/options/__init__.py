"""Defines the options of a plug-in: fields with units, documented in the source."""
