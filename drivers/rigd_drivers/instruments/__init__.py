"""Drivers of instruments that answer questions or send lines of text."""
