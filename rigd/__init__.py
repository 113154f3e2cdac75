"""rigd: controller and data-acquisition daemon for friction and traction test rigs.

In a notebook: ``recording = rigd.load("runs/pvc.mcap")``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from os import PathLike

    from rigd.record import Recording

__version__ = "0.1.0"


def load(path: str | PathLike[str]) -> Recording:
    """Return a recording, opened to read.

    Raises:
        RecordingError: the file is missing, empty, cut short, or no MCAP file.

    """
    from rigd.record import Recording  # numpy and mcap take 0.2 s: only reading needs them

    return Recording.open(path)
