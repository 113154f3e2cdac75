"""``rigd completion``: prints the script with which a shell completes rigd commands."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

HELP = "print a completion script for your shell"
EXAMPLES = """\
examples:
  rigd completion bash > ~/.local/share/bash-completion/completions/rigd
  rigd completion zsh > "${fpath[1]}/_rigd"
  rigd completion fish > ~/.config/fish/completions/rigd.fish
"""


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("shell", choices=("bash", "zsh", "tcsh", "fish"), help="the shell you use")


def execute(args: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    for action in _free(args.parser):
        action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(args.parser, shell=args.shell))
    return 0


def _free(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield what takes a value that is no choice, of all commands: most of these are files."""
    for action in parser._actions:  # noqa: SLF001 - argparse has no other way to list them
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            for command in action.choices.values():
                yield from _free(command)
        elif action.nargs != 0 and action.choices is None:
            yield action
