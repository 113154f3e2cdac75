"""``python -m rigd`` is the command ``rigd``."""

import sys

from rigd.cli.main import main

sys.exit(main())
