"""Lists possible errors of the model of a lateral sweep: those of the rig, and of the coupling.

What depends on the lateral speed is what the rollers' friction is found from: if the residuals
still do, another law holds, and no number of the coupling means anything.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rigd.analysis.output_error.structure import Context, Suspect, dependences
from rigd.analysis.result import FloatArray, Meaning
from rigd_analyses.lugre.lateral.system import LateralSystem
from rigd_analyses.lugre.rig.disturbances import Disturbed
from rigd_analyses.lugre.rig.extensions import FRICTION, sources, suspects

FOUND_FROM = ("a force on the carriage", FRICTION)
LOOK = "guide_lever, guide_height, row_distance and mass_offset"


def candidates(system: LateralSystem, theta: FloatArray) -> Iterator[Suspect]:
    """Yield what may be wrong, at the parameters ``theta`` (p,) of ``system``."""
    count = len(system.shared)
    shared, local = theta[:count], theta[count:]
    straight = np.concatenate([shared[: len(system.rig.shared)], local])
    trials = range(len(system.speeds))
    rig = Disturbed(system.rig, straight, [system.effective(k, shared) for k in trials])
    yield from suspects(rig)
    speeds = [
        np.interp(m.time, np.linspace(0.0, m.time[-1], len(speed)), speed)
        for m, speed in zip(rig.motions, system.speeds, strict=True)
    ]
    found_from = [item for item in sources(rig) if item.name in FOUND_FROM]
    for item in dependences(found_from, [Context("the lateral speed", speeds)]):
        yield replace(item, special=True, look=LOOK, meaning=Meaning.LAW)
