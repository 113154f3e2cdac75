"""Instruments that take commands and answer questions as SCPI has them, described in a rig file."""
