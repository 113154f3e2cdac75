"""Drivers of data acquisition cards, and of amplifiers and encoders at their terminals."""
