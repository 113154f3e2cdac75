"""The recorder: a process of its own that brings what is in the rings to disk."""

from rigd.engine.recorder.leftovers import drain_into, drain_leftovers
from rigd.engine.recorder.process import Health, RecorderProcess

__all__ = ["Health", "RecorderProcess", "drain_into", "drain_leftovers"]
