"""Finds the rig of a command: the one that is given, or what stands for it.

In this order: ``--rig``; the variable ``RIGD_RIG``; ``default_rig`` in the settings file of the
folder; the simulated rig that the procedure names for a first try. So no rig moves that nobody has
named.
"""

from __future__ import annotations

from pathlib import Path

from rigd.config.loader import load_rig
from rigd.config.settings import SETTINGS_FILE
from rigd.config.sibling.stated_rig import RIG_VARIABLE, ChosenRig, stated_rig
from rigd.model.errors import ConfigError
from rigd.procedure.loader import load_procedure


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
