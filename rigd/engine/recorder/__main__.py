"""Runs the recorder of the run in FOLDER: ``python -m rigd.engine.recorder FOLDER``."""

import sys
from pathlib import Path

from rigd.engine.recorder.service import RecorderService
from rigd.engine.shared import RunFolder
from rigd.model.errors import RecordingError

if __name__ == "__main__":
    try:
        sys.exit(RecorderService(RunFolder.at(Path(sys.argv[1]))).run())
    except RecordingError as error:
        sys.exit(error.message)  # there is no board for the error
