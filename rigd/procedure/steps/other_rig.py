"""Recognises a procedure that is right, but for another rig."""

from __future__ import annotations

import difflib
from collections.abc import Collection
from typing import TYPE_CHECKING

from rigd.model.errors import ConfigError, OtherRigError, Place
from rigd.procedure.steps.prompts import PLANT

if TYPE_CHECKING:
    from rigd.config.rig import RigConfig


def other_rig(
    error: ConfigError, name: str, rig: RigConfig, own: Collection[str]
) -> OtherRigError | None:
    """Return the error of the procedure ``name`` if it only lacks devices of ``rig``, else None.

    A name that is close to the name of a device of the rig is a misspelling. Groups of derived
    channels that are the procedure's ``own`` are not of the rig.
    """
    lacked: dict[str, Place | None] = {}
    for item in (error, *error.others):
        lacked.setdefault(item.lacks.partition(".")[0], item.place)
    # "rig" and "plant" are the constants and the plant of the rig for which the procedure is.
    devices = set(lacked) - {"rig", PLANT, *own}
    if "" in lacked or not devices or devices & set(rig.devices):
        return None
    if any(difflib.get_close_matches(item, rig.devices, n=1, cutoff=0.8) for item in devices):
        return None
    missing = tuple(sorted(devices))
    return OtherRigError(name, rig.name, missing, lacked[missing[0]])
