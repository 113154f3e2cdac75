"""Hears what libraries warn of while they read a file; by themselves they only print it."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

#: What these say is of the code, not of a file.
_OF_CODE: Final = (DeprecationWarning, PendingDeprecationWarning, FutureWarning, ResourceWarning)


class _Ear(logging.Filter):
    """Keeps the records of loggers from being printed while somebody listens."""

    heard: list[str] | None = None

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is printed."""
        if self.heard is None or record.levelno < logging.WARNING:
            return True
        self.heard.append(f"{record.name.partition('.')[0]}: {record.getMessage()}")
        return False


_EAR: Final = _Ear()


def hear(library: str) -> None:
    """Hear from now on what the loggers of a library say, which has been imported."""
    for name in list(logging.root.manager.loggerDict):
        if name.partition(".")[0] == library:
            logging.getLogger(name).addFilter(_EAR)


@contextmanager
def listening() -> Iterator[list[str]]:
    """Collect the warnings of libraries until the end of the context, in place of printing."""
    heard: list[str] = []

    def note(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        if not issubclass(category, _OF_CODE):
            heard.append(f"{category.__module__.partition('.')[0]}: {message}")

    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = note
        _EAR.heard = heard
        try:
            yield heard
        finally:
            _EAR.heard = None
