"""A map of a small table, and the kind of function that imports with it."""

from collections.abc import Callable

from rigd.record import Recording

MAP = """\
map: bench
rig: old_bench
started: 2016-03-04T10:00:00Z
sources:
  samples:
    text: {}
    time: {column: t, unit: s}
    channels:
      force: {column: F, unit: N}
      speed: {column: v, unit: mm/s}
"""

Import = Callable[..., Recording]
