"""The rig that the environment or the settings of the present folder state."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.config.loader import load_rig
from rigd.config.settings import SETTINGS_FILE, read_settings
from rigd.model.errors import ConfigError

#: The variable that names the rig of all commands.
RIG_VARIABLE: Final = "RIGD_RIG"


@dataclass(frozen=True)
class ChosenRig:
    """A rig file or the name of a rig; ``why`` is the line that says which and why, or ""."""

    rig: str
    why: str = ""


def stated_rig() -> ChosenRig | None:
    """Return the rig that the environment or the settings of this folder state; None if none.

    Raises:
        ConfigError: the settings are wrong, or there is no such rig.
    """
    named = os.environ.get(RIG_VARIABLE, "").strip()
    if named:
        return _described(named, RIG_VARIABLE)
    settings = Path(SETTINGS_FILE)
    if not settings.is_file():
        return None
    return _described(read_settings(settings).default_rig, SETTINGS_FILE)


def _described(named: str, by: str) -> ChosenRig:
    """Return the rig that ``by`` names, with the line for the user."""
    try:
        rig = load_rig(named)
    except ConfigError as error:
        if error.place is not None:
            raise
        raise ConfigError(f"{by}: {error.message}", hint=error.hint) from error
    if rig.plant is not None:
        what = f"simulated on {rig.name}, as {by} says, nothing moves"
    elif rig.simulation is not None:
        what = f"{rig.name}, simulated at the wire, as {by} says"
    else:
        what = f"the real rig {rig.name}, as {by} says"
    return ChosenRig(named, f"no --rig: {what}")
