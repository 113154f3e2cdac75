"""Progress bar of the trials of a run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, ProgressColumn, TaskProgressColumn, TextColumn


class TrialBar:
    """A bar on standard error where that is a terminal; elsewhere, only what is told in lines.

    ``columns`` stand at the right of it.
    """

    def __init__(self, *columns: ProgressColumn, quiet: bool) -> None:
        self._quiet = quiet
        self._console = Console(stderr=True, highlight=False)
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            *columns,
            console=self._console,
            disable=quiet or not self._console.is_terminal,
        )

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._bar.stop()

    @contextmanager
    def quiet(self) -> Iterator[None]:
        """Take the bar off the screen for a while."""
        self._bar.stop()
        try:
            yield
        finally:
            self._bar.start()

    def tell(self, line: str) -> None:
        """Show a line, also when quiet: it answers what a person just did."""
        self._console.print(f"[yellow]{escape(line)}[/]")
