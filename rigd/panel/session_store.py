"""Stores the panel's sessions in a file, so that they survive a restart."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import StringConstraints, TypeAdapter, ValidationError

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class StoredSession:
    """A session as it is kept; the hash of its key lets nobody in."""

    key_sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
    name: str
    role: Literal["operator", "observer"]
    number: int
    idle_s: float | None  #: for how long no page of it had been open; None while one was
    has_control: bool = False


@dataclass(frozen=True)
class _Page:
    written_unix_s: float
    sessions: tuple[StoredSession, ...]


_PAGE = TypeAdapter(_Page)


class SessionStore:
    """A file with the sessions of a panel, which only its user can read.

    So a panel that was killed, or ended with its daemon, needs no new link for each screen.
    """

    def __init__(self, path: Path, wall: Callable[[], float] = time.time) -> None:
        self._path = path
        self._wall = wall

    def read(self) -> tuple[float, Sequence[StoredSession]]:
        """Return the sessions, and how long ago they were written, in s.

        Where they cannot be read, the log says so, and each screen needs a new link.
        """
        try:
            page = _PAGE.validate_json(self._path.read_bytes())
        except FileNotFoundError:
            return 0.0, ()
        except (OSError, ValidationError) as error:
            _log.warning("%s cannot be read, each screen needs a new link: %s", self._path, error)
            return 0.0, ()
        return max(self._wall() - page.written_unix_s, 0.0), page.sessions

    def write(self, sessions: Sequence[StoredSession]) -> None:
        """Keep the sessions, whole or not at all; a failure is logged."""
        draft = self._path.with_name(f"{self._path.name}.new")
        try:
            draft.unlink(missing_ok=True)
            with draft.open("xb") as file:
                os.fchmod(file.fileno(), 0o600)
                file.write(_PAGE.dump_json(_Page(self._wall(), tuple(sessions))))
            draft.replace(self._path)
        except OSError as error:
            _log.warning("%s cannot be written: %s", self._path, error.strerror)
