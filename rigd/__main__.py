"""Runs the command ``rigd``, also as ``python -m rigd``."""

import signal
import sys

#: :attr:`rigd.model.errors.Exit.STOPPED`; its module may not be there yet.
_STOPPED = 5


def main() -> int:
    """Return the exit code of the command line; Ctrl-C may come while the command is imported."""
    try:
        from rigd.cli.main import main as command

        return command()
    except KeyboardInterrupt:
        sys.stderr.write("rigd: interrupted\n")
        return _STOPPED
    finally:  # all is said and written: while the interpreter ends, Ctrl-C would print a traceback
        signal.signal(signal.SIGINT, signal.SIG_IGN)


if __name__ == "__main__":
    sys.exit(main())
