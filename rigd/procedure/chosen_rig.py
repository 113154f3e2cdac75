"""Finds the rig of a command: the one that is given, or what stands for it.

In this order: ``--rig``; the variable ``RIGD_RIG``; ``default_rig`` in the settings file of the
folder; the simulated rig that the procedure names for a first try. So no rig moves that nobody has
named.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rigd.config.loader import load_rig
from rigd.config.settings import SETTINGS_FILE, read_settings
from rigd.model.errors import ConfigError
from rigd.procedure.loader import load_procedure

#: The variable that names the rig of all commands.
RIG_VARIABLE: Final = "RIGD_RIG"


@dataclass(frozen=True)
class ChosenRig:
    """A rig file or the name of a rig; ``why`` is the line that says which and why, or ""."""

    rig: str
    why: str = ""


def chosen_rig(given: str | None, procedure: str | Path | None = None) -> ChosenRig:
    """Return the rig that is meant if ``given`` was given; ``procedure`` is a file or a name.

    Raises:
        ConfigError: no rig is given or stated anywhere, or what states it is wrong.
    """
    if given is not None:
        return ChosenRig(given)
    found = stated_rig() or (None if procedure is None else try_rig(procedure))
    if found is None:
        tried = "" if procedure is None else ", or `try_on: RIG` into the procedure"
        raise ConfigError(
            "no rig is given",
            hint=f"give --rig RIG, set {RIG_VARIABLE}, or write `default_rig: RIG` into "
            f"{SETTINGS_FILE} in this folder{tried}",
        )
    return found


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


def try_rig(procedure: str | Path) -> ChosenRig | None:
    """Return the simulated rig that ``procedure`` names for a first try; None if it names none.

    Raises:
        ConfigError: the procedure is wrong, there is no such rig, or it is not simulated in
            process.
    """
    found = load_procedure(procedure)
    named = found.source.try_on
    if named is None:
        return None
    place = found.document.place(("try_on",))
    try:
        rig = load_rig(named)
    except ConfigError as error:
        raise ConfigError(f"try_on: {error.message}", place=place, hint=error.hint) from error
    if rig.plant is None:
        raise ConfigError(
            f"try_on names the rig {rig.name} ({rig.source.path}), which has no `plant`",
            place=place,
            hint="name a rig that is simulated in process: nothing else moves unless it is named",
        )
    return ChosenRig(named, f"no --rig: simulated on {rig.name}, nothing moves")


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
