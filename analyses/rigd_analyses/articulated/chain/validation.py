"""Tries identified contacts of a chain on other recordings, by the tests of :mod:`..validation`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rigd.analysis import DataError, Options
from rigd.analysis.parameters import complete_groups
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.result import TrialRejection
from rigd.analysis.validation.result import Validation
from rigd.analysis.validation.saved_models import SavedModel, chosen
from rigd_analyses.articulated.chain.evaluation import SLIDES, chain_system, checked
from rigd_analyses.articulated.chain.layout import Layout, layout_of
from rigd_analyses.articulated.chain.needs import KINDS
from rigd_analyses.articulated.chain.system import (
    ALIKE_U,
    UNITS,
    ChainSystem,
    contact_name,
    unit_of,
)
from rigd_analyses.articulated.evaluation import certain_grip
from rigd_analyses.articulated.search import fitted_from
from rigd_analyses.articulated.validation import (
    HEADING,
    PLACE,
    TORQUE,
    Known,
    Robot,
    judged,
    known_of,
    validation,
)

NEEDED: Final = (
    "k_lon",
    "k_roll",
)  #: k_lat is free if the model has none, as straight runs leave it


def validate(
    models: Sequence[SavedModel],
    sweeps: Sequence[RecordedSweep],
    group: str,
    notify: Callable[[str], None],
) -> Validation:
    """Return how all trials of ``sweeps`` in which contacts grip agree with a model.

    Raises:
        ConfigError: the model is not usable, or is of other modules.
        DataError: a recording lacks a signal or constant, constants differ, or no trial is left.
    """
    saved = chosen(models, {}, group)
    trials = [t for found in complete_groups(sweeps, Options(), notify) for t in found.trials]
    contacts = contacts_of(saved, layout_of(trials))
    known = {name: (item.value, item.u) for name, item in contacts.items()}
    grip = certain_grip(trials)
    system, folded = checked(chain_system(trials, known))
    point = np.array([item.parameter.start for item in system.shared])
    shares = [system.share(k, point) for k in range(len(system.trials))]
    kept = [k for k, share in enumerate(shares) if share <= grip]
    left_out = folded + tuple(
        TrialRejection(item.label, SLIDES.format(share=share, grip=grip))
        for item, share in zip(system.trials, shares, strict=True)
        if share > grip
    )
    if not kept:
        raise DataError(
            f"a contact may slide in each trial: with {saved.name} it carries more than {grip:g} "
            "times its load",
            hint="record slower circles, and straight runs with a ramp",
        )
    system = system.of(kept)
    notify(f"{len(kept)} trials by the model {saved.name}")
    played = {(str(sweep.path), info.number): (sweep, info) for sweep, info in trials}
    conditions = [
        {name: sweep.parameter(info, name) for name in info.parameters}
        for sweep, info in (played[item.recording, item.number] for item in system.trials)
    ]
    local = np.array([item.parameter.start for item in system.local])
    fit = fitted_from(system, np.concatenate([point, np.tile(local, len(kept))]))
    robot = Robot(system, _columns(system), tuple(known), unit_of)
    found = replace(judged(saved.name, robot, fit, conditions), left_out=left_out)
    return validation("articulated-chain", saved, sweeps, found, contacts)


def contacts_of(saved: SavedModel, layout: Layout) -> dict[str, Known]:
    """Return the contacts of each module that ``saved`` has a number of, by name.

    A module without one has the mean of its kind, of which it may be as far off as modules are.

    Raises:
        ConfigError: it did not fit its own recordings, is of other modules, or a value is
            impossible.
    """
    names = {contact_name(kind, k): kind for kind, k in layout.contacts}
    found = known_of(saved, {kind: UNITS[kind] for kind in KINDS} | {
        name: UNITS[kind] for name, kind in names.items()
    })  # fmt: skip
    contacts: dict[str, Known] = {}
    for name, kind in names.items():
        if name in found:
            contacts[name] = found[name]
        elif kind in found:
            mean = found[kind]
            contacts[name] = Known(mean.value, math.hypot(mean.u, ALIKE_U), mean.stated)
        elif kind in NEEDED:
            raise saved.error(
                f"the model has no value of {name}: these recordings are of "
                f"{layout.modules} modules, of which {_driven(layout)} drive",
                ("parameters",),
                hint="try it on recordings of the same robot, or identify straight runs at several "
                "speeds",
            )
    more = _others(saved, names)
    if more:
        raise saved.error(
            f"the model has {', '.join(more)}, and these recordings are of {layout.modules} "
            f"modules, of which {_driven(layout)} drive",
            ("parameters", more[0]),
            hint="try it on recordings of the same robot",
        )
    return contacts


def _driven(layout: Layout) -> str:
    return ", ".join(str(k + 1) for k in layout.of_kind("k_lon"))


def _others(saved: SavedModel, names: Mapping[str, str]) -> list[str]:
    """Return the contacts of other modules that a model has."""
    given = saved.get("parameters")
    every = given if isinstance(given, Mapping) else {}
    return [name for name in every if name not in names and name not in KINDS]


def _columns(system: ChainSystem) -> dict[str, tuple[tuple[int, ...], str]]:
    """Return the columns of the outputs that each judged output has, and its unit."""
    m, width = system.motors, len(system.outputs)
    places = [k for k in range(m, width) if (k - m) % 3 < 2]
    return {
        PLACE: (tuple(places), "m"),
        HEADING: (tuple(range(m + 2, width, 3)), "rad"),
        TORQUE: (tuple(range(m)), "N m"),
    }
