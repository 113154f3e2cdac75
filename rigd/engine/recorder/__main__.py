"""``python -m rigd.engine.recorder FOLDER``: the recorder of the run in that folder."""

import sys
from pathlib import Path

from rigd.engine.recorder.service import Service
from rigd.engine.shared import RunFolder

if __name__ == "__main__":
    sys.exit(Service(RunFolder.at(Path(sys.argv[1]))).run())
