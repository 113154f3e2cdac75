"""``rigd identify``: recordings to friction parameters with honest uncertainties, and a report."""

from __future__ import annotations

import argparse

HELP = "identify"
EXAMPLES = ""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""


def execute(args: argparse.Namespace) -> int:
    """Identify."""
    return 0
