"""Reads the settings file of a folder: what its commands use that their user does not state."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from rigd.config.binding import bind
from rigd.config.document import read_document
from rigd.config.problems import Problems
from rigd.config.source import FilePath, Source
from rigd.model.errors import ConfigError

#: Its name, in the folder in which a command is called.
SETTINGS_FILE: Final = "rigd.yaml"


class SettingsSource(Source):
    """The settings of a folder."""

    default_rig: FilePath
    """Rig file, or the rig's name, of commands that are given no rig."""


def read_settings(path: Path) -> SettingsSource:
    """Return the settings in the file ``path``.

    Raises:
        ConfigError: it cannot be read, or is wrong; with every problem and its place.
    """
    problems = Problems()
    document = read_document(path)
    source = bind(document, SettingsSource, problems)
    problems.raise_any()
    if source is None:
        raise ConfigError("the settings cannot be used", place=document.place(()))
    return source
