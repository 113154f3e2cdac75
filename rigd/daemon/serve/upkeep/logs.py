"""Writes the log of the daemon: text if the output is a terminal, otherwise JSON lines.

A separate thread writes the records. A thread that logs never waits for a terminal or a disk.
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
    """Log to ``stream`` inside; JSON if it is no terminal, unless ``as_json`` decides."""
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
    """Formats a record as a JSON object in one line: time, level, logger, message."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as JSON."""
        entry = {
            "time": _time(record).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_info:
            entry["traceback"] = self.formatException(record.exc_info)
        elif record.exc_text:
            entry["traceback"] = record.exc_text
        return json.dumps(entry, ensure_ascii=False)


class ForPeople(logging.Formatter):
    """Formats a record as a line of text: time of day, level if it is above info, message."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the record as a line, followed by the traceback if there is one."""
        level = "" if record.levelno <= logging.INFO else f"{record.levelname.lower()}: "
        line = f"{_time(record).astimezone():%H:%M:%S} {level}{record.getMessage()}"
        if record.exc_info:
            line += f"\n{self.formatException(record.exc_info)}"
        elif record.exc_text:
            line += f"\n{record.exc_text}"
        return line


def _time(record: logging.LogRecord) -> datetime:
    return datetime.fromtimestamp(record.created, UTC)
