"""The commands that README and every ``--help`` show, as a reader would type them."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from rigd.cli.main import build_parser

README: Final = Path(__file__).resolve().parents[3] / "README.md"
_FENCE: Final = re.compile(r"^```sh\n(.*?)^```$", re.M | re.S)
_CODE: Final = re.compile(r"`((?:rigd|make|pip|pipx|uv) [^`]+)`")
_EXAMPLE: Final = re.compile(r"^  ((?:rigd|pip) .*?)(?: {2,}.*| +# .*)?$", re.M)


def of_readme() -> list[str]:
    """Return the commands of README's shell blocks, tables and sentences."""
    text = README.read_text("utf-8")
    lines = [
        line.partition(" # ")[0].strip()
        for block in _FENCE.findall(text)
        for line in block.replace("\\\n", "").splitlines()
    ]
    return [*filter(None, lines), *_CODE.findall(_FENCE.sub("", text))]


def of_help() -> list[str]:
    """Return the commands under the ``--help`` of ``rigd`` and all its subcommands."""
    epilogs = (parser.epilog or "" for parser in _parsers(build_parser()))
    return [
        match[1] for text in epilogs for match in _EXAMPLE.finditer(re.sub(r"\\\n *", "", text))
    ]


def _parsers(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    yield parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name in action.choices:
                yield from _parsers(action.choices[name])


def words_of(command: str, stands_for: Mapping[str, str]) -> list[str]:
    """Return the words of ``command`` as a shell passes them on in the current folder.

    ``stands_for`` gives what a reader puts in for a placeholder.
    """
    for placeholder, value in stands_for.items():
        assert placeholder in command, (placeholder, command)
        command = command.replace(placeholder, value)
    return [
        name
        for word in shlex.split(command)
        for name in ((sorted(map(str, Path().glob(word))) if "*" in word else []) or [word])
    ]
