"""The log of the daemon: text at a terminal, JSON lines elsewhere.

Records are written by a thread of their own: whoever logs never waits for a terminal or a disk.
"""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from logging.handlers import QueueHandler, QueueListener
from queue import SimpleQueue
from typing import TextIO


@contextmanager
def logging_to(stream: TextIO = sys.stderr, *, as_json: bool | None = None) -> Iterator[None]:
    """Log to ``stream`` while inside; JSON where it is no terminal, unless ``as_json`` says."""
    structured = not stream.isatty() if as_json is None else as_json
    writer = logging.StreamHandler(stream)
    writer.setFormatter(JsonLines() if structured else ForPeople())
    waiting: SimpleQueue[logging.LogRecord] = SimpleQueue()
    listener = QueueListener(waiting, writer)
    root, handler = logging.getLogger(), QueueHandler(waiting)
    before = root.level
    root.addHandler(handler)
    root.setLevel(logging.INFO)
    listener.start()
    try:
        yield
    finally:
        root.removeHandler(handler)
        root.setLevel(before)
        listener.stop()


class JsonLines(logging.Formatter):
    """One object per line: time, level, where it comes from, what happened."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as JSON."""
        said = {
            "time": _time(record).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_info:
            said["traceback"] = self.formatException(record.exc_info)
        elif record.exc_text:
            said["traceback"] = record.exc_text
        return json.dumps(said, ensure_ascii=False)


class ForPeople(logging.Formatter):
    """A line: the time of day, what is amiss if anything is, what happened."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as a line, with the traceback below where there is one."""
        level = "" if record.levelno <= logging.INFO else f"{record.levelname.lower()}: "
        line = f"{_time(record).astimezone():%H:%M:%S} {level}{record.getMessage()}"
        if record.exc_info:
            line += f"\n{self.formatException(record.exc_info)}"
        elif record.exc_text:
            line += f"\n{record.exc_text}"
        return line


def _time(record: logging.LogRecord) -> datetime:
    return datetime.fromtimestamp(record.created, UTC)
