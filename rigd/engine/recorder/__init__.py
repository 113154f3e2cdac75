"""Provides the recorder: the process that moves rows and events from the rings to disk."""

from rigd.engine.recorder.leftovers import drain_into, drain_leftovers
from rigd.engine.recorder.process import Health, RecorderProcess

__all__ = ["Health", "RecorderProcess", "drain_into", "drain_leftovers"]
