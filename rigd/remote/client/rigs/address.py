"""A rig of the client's list as plain data, and where that list stands; imports no YAML reader."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from rigd.config.remote import DEFAULT_ENDPOINT, TlsFiles


@dataclass(frozen=True)
class Remote:
    """A rig of the list."""

    endpoint: str = DEFAULT_ENDPOINT
    tls: TlsFiles | None = None
    identity: str | None = None

    @classmethod
    def of(cls, line: Mapping[str, Any]) -> Self:
        """Return the rig whose fields are in ``line``, paths as text.

        Raises:
            KeyError, TypeError: they are others.
        """
        tls = line["tls"]
        files = None if tls is None else TlsFiles(**{name: Path(tls[name]) for name in tls})
        return cls(line["endpoint"], files, line["identity"])


def list_path() -> Path:
    """Return the path of the list, by the XDG base directory specification."""
    return rigd_folder("XDG_CONFIG_HOME", ".config") / "remotes.yaml"


def rigd_folder(variable: str, usual: str) -> Path:
    """Return the folder of rigd below that of an XDG variable, or below the usual one at home."""
    given = os.environ.get(variable) or ""
    return (Path(given) if Path(given).is_absolute() else Path.home() / usual) / "rigd"
