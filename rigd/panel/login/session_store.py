"""Stores the panel's sessions in a file, so that they are still valid after a restart."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import StringConstraints, TypeAdapter, ValidationError

from rigd.panel.messages import Role

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class StoredSession:
    """A stored session; it contains only the hash of its key, which opens no session."""

    key_sha256: Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
    name: str
    role: Role
    idle_s: float | None  #: time since its last page closed; None if a page was open


@dataclass(frozen=True)
class _Page:
    written_unix_s: float
    sessions: tuple[StoredSession, ...]


_PAGE = TypeAdapter(_Page)


class SessionStore:
    """A file with the sessions of a panel, which only its user can read.

    If a panel is killed, or ends with its daemon, open screens need no new link.
    """

    def __init__(self, path: Path, wall: Callable[[], float] = time.time) -> None:
        self._path = path
        self._wall = wall

    def read(self) -> tuple[float, Sequence[StoredSession]]:
        """Return the sessions, and the time since they were written, in s.

        If they cannot be read, a warning is logged, and each screen needs a new link.
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
        """Write the sessions, all or none; a failure is logged."""
        draft = self._path.with_name(f"{self._path.name}.new")
        try:
            draft.unlink(missing_ok=True)
            with draft.open("xb") as file:
                os.fchmod(file.fileno(), 0o600)
                file.write(_PAGE.dump_json(_Page(self._wall(), tuple(sessions))))
            draft.replace(self._path)
        except OSError as error:
            _log.warning("%s cannot be written: %s", self._path, error.strerror)
