"""Prints a table that fits as it is, without Rich: its import takes 0.07 s of processor time."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Collection, Sequence

#: Width of a line that is not shown at a terminal, as :func:`rigd.cli.views.screen.open_console`
#: has it.
_PIPE_WIDTH = 400
_GAP = "  "


def plain_table(
    heads: Sequence[str], rows: Sequence[Sequence[str]], right: Collection[int]
) -> str | None:
    """Return a table in columns; those of the numbers ``right`` are aligned to the right.

    None if it is wider than the terminal, or a cell has several lines or a letter that may be wider
    than a column: then :func:`rigd.cli.views.screen.print_rows` folds it.
    """
    lines = [heads, *rows]
    widths = [max(map(len, cells)) for cells in zip(*lines, strict=True)]
    columns = shutil.get_terminal_size().columns if sys.stdout.isatty() else _PIPE_WIDTH
    if sum(widths) + len(_GAP) * (len(widths) - 1) > columns:
        return None
    padded = [
        _GAP.join(
            cell.rjust(width) if number in right else cell.ljust(width)
            for number, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
    text = "\n".join(padded)
    plain = (
        text.isascii() and text.count("\n") == len(rows) and text.replace("\n", "").isprintable()
    )
    return text if plain else None
