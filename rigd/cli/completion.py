"""``rigd completion``: prints the script with which a shell completes rigd commands."""

from __future__ import annotations

import argparse

HELP = "print a completion script for your shell"
EXAMPLES = """\
examples:
  rigd completion bash > ~/.local/share/bash-completion/completions/rigd
  rigd completion zsh > "${fpath[1]}/_rigd"
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("shell", choices=("bash", "zsh", "tcsh"), help="the shell you use")


def execute(args: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    print(shtab.complete(args.parser, shell=args.shell))
    return 0
