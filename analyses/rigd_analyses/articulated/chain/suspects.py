"""Lists what may be wrong with a chain of modules beyond its constants, and how it would show.

Each suspect is the change of the outputs for each unit of it, at the fitted motion. What acts on
the robot goes along with one simulation of each trial, a lane for each thing; so do the sizes of
single modules that the plan states of all together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from rigd.analysis.output_error.structure import (
    ANY,
    POSITIVE,
    Suspect,
    dependences,
)
from rigd.analysis.result import FloatArray, Meaning
from rigd_analyses.articulated.chain.geometry import RAW, motion
from rigd_analyses.articulated.chain.kernel import FORCES, HALF_BASE, HALF_TRACK, K_LAT, K_LON
from rigd_analyses.articulated.chain.layout import SIZES
from rigd_analyses.articulated.chain.system import ChainSystem, Run, unit_of
from rigd_analyses.articulated.extensions import END, RUBBING_RAD_S, SIDE
from rigd_analyses.articulated.suspects import FittedMotion, lane, off, turned

ALONG, ACROSS, TURN = range(FORCES)
SIZE_WORDS: Final = {
    "hinge_ahead": "distance of the hinge ahead",
    "hinge_behind": "distance of the hinge behind",
}


@dataclass(frozen=True, eq=False)
class Acting:
    """Something that acts on the robot, and its forces (n, modules, FORCES) in one trial."""

    name: str
    unit: str
    look: str
    forces: Callable[[int], FloatArray]
    meaning: Meaning = Meaning.NUISANCE
    possible: tuple[float, float] = ANY


@dataclass(frozen=True, eq=False)
class Fitted(FittedMotion[ChainSystem, Run]):
    """A fitted motion and how things that the model does not have would change it."""

    @property
    def modules(self) -> int:
        """Return how many modules there are."""
        return self.system.layout.modules

    def simulated(self, trial: int) -> Run:
        """Return the simulation of one trial, with a lane for each raw value."""
        directions = np.eye(len(self.system.raw(self.shared)))
        return self.system.run(trial, self.shared, self.local(trial), directions)

    @cached_property
    def by_raw(self) -> list[FloatArray]:
        """Return the changes of the outputs of each trial by the raw values of the modules."""
        return [
            self.system.outputs_of(k, run, self.shared, self.local(k))
            for k, run in enumerate(self.runs)
        ]

    @cached_property
    def acting(self) -> tuple[Acting, ...]:
        """Return what may act on the robot."""
        return tuple(_acting(self))

    @cached_property
    def acted(self) -> list[FloatArray]:
        """Return the changes of the outputs of each trial by :attr:`acting`."""
        count, found = len(self.system.raw(self.shared)), []
        for k in range(len(self.system.trials)):
            pushes = np.stack([thing.forces(k) for thing in self.acting], axis=3)
            run = self.system.run(
                k, self.shared, self.local(k), np.zeros((count, 0)), pushes=pushes
            )
            found.append(self.system.outputs_of(k, run, self.shared, self.local(k)))
        return found


def candidates(system: ChainSystem, theta: FloatArray) -> Iterator[Suspect]:
    """Yield what may be wrong, at the parameters ``theta`` (p,) of ``system``."""
    at = Fitted(system, theta)
    for index, thing in enumerate(at.acting):
        yield Suspect(
            thing.name, thing.unit, lane(lambda: at.acted, index), thing.look, special=True,
            meaning=thing.meaning, possible=thing.possible,
        )  # fmt: skip
    yield from _sizes(at)
    yield from _seen(at)
    yield from _torques(at)
    hinges = [
        f"the angle of the hinge behind the {name} module" for name in system.layout.names[:-1]
    ]
    yield from dependences(at.sources(), at.contexts(hinges))


def _acting(at: Fitted) -> Iterator[Acting]:
    """Yield what may act on the robot."""
    system, names, n = at.system, at.system.layout.names, at.modules

    def none(trial: int) -> FloatArray:
        return np.zeros((len(system.trials[trial].poses), n, FORCES))

    def hinged(behind: int, moment: Callable[[FloatArray, FloatArray], FloatArray]) -> Callable[
        [int], FloatArray
    ]:  # fmt: skip
        def forces(trial: int) -> FloatArray:
            states, out = at.runs[trial].states, none(trial)
            angle = states[:, 1 + behind] - states[:, 2 + behind]
            rate = states[:, n + 3 + behind] - states[:, n + 4 + behind]
            out[:, behind - 1, TURN] = moment(angle, rate)
            out[:, behind, TURN] = -out[:, behind - 1, TURN]
            return out

        return forces

    def wheels(share: Callable[[int, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]) -> (
        Callable[[int], FloatArray]
    ):  # fmt: skip
        """Return forces by those (n, modules, 4) of the wheels that are added, along and across."""

        def forces(trial: int) -> FloatArray:
            run, out = at.runs[trial], none(trial)
            shape = (len(out), n, 4)
            along, across = (part.reshape(shape) for part in system.forces(trial, run))
            along, across = share(trial, along, across)
            out[:, :, ALONG], out[:, :, ACROSS] = along.sum(axis=2), across.sum(axis=2)
            d, b = run.values[:, HALF_BASE], run.values[:, HALF_TRACK]
            out[:, :, TURN] = d * (across @ END) - b * (along @ SIDE)
            return out

        return forces

    for k in range(1, n):
        place = f"the hinge behind the {names[k - 1]} module"
        yield Acting(
            f"{place} springs back", "N m/rad", f"cables across {place}, and its stop",
            hinged(k, lambda angle, _: -angle), possible=POSITIVE,
        )  # fmt: skip
        yield Acting(
            f"{place} rubs", "N m", f"the bearing of {place}",
            hinged(k, lambda _, rate: -np.tanh(rate / RUBBING_RAD_S)), possible=POSITIVE,
        )  # fmt: skip

    def dragged(trial: int) -> FloatArray:
        out = none(trial)
        along, _, _ = motion(at.runs[trial].values, at.runs[trial].states)
        out[:, 0, ALONG] = -along[:, 0] * np.abs(along[:, 0])
        return out

    yield Acting("drag with the square of the speed", "N s^2/m^2", "cables that the robot pulls",
                 dragged, possible=POSITIVE)  # fmt: skip
    values = at.runs[0].values
    turned = (system.layout.driven > 0.0)[:, [0, 1, 0, 1]]
    k_lon, k_lat = values[:, K_LON, None], values[:, K_LAT, None]
    yield Acting(
        "longitudinal forces that are not in proportion to the slip", "s/m",
        "another law of the contacts",
        wheels(lambda _, lon, lat: (turned * lon * np.abs(lon) / k_lon, 0.0 * lat)), Meaning.LAW,
    )  # fmt: skip
    yield Acting(
        "lateral forces that are not in proportion to the lateral speed", "s/m",
        "another law of the contacts",
        wheels(lambda _, lon, lat: (0.0 * lon, lat * np.abs(lat) / k_lat)), Meaning.LAW,
    )  # fmt: skip

    def shifted(_: int, lon: FloatArray, lat: FloatArray) -> tuple[FloatArray, FloatArray]:
        load = system.wheel_loads(at.shared).reshape(n, 4)
        over = -SIDE * lat.sum(axis=2)[:, :, None] / values[:, HALF_TRACK, None]
        over -= END * lon.sum(axis=2)[:, :, None] / values[:, HALF_BASE, None]
        share = over / (4.0 * load)
        return lon * share, lat * share

    yield Acting(
        "loads that shift with the forces, by a height", "m",
        "the height of the centre of mass: the model takes the loads of a module as equal",
        wheels(shifted), Meaning.LAW, POSITIVE,
    )  # fmt: skip

    def since(trial: int, lon: FloatArray, lat: FloatArray) -> tuple[FloatArray, FloatArray]:
        t_s = system.trials[trial].t_s[:, None, None]
        return lon * t_s, lat * t_s

    yield Acting(
        "contacts that change in the course of a trial", "1/s", "tyres and floor: wear, dirt",
        wheels(since), Meaning.VARIES,
    )  # fmt: skip


def _sizes(at: Fitted) -> Iterator[Suspect]:
    """Yield other sizes of single modules, where the plan states one for several."""
    system, keys = at.system, at.system.layout.keys
    for module, own in enumerate(keys):
        for name, key in zip(SIZES, own, strict=True):
            if sum(row.count(key) for row in keys) < 2 or not key:
                continue
            index = len(RAW) * module + RAW.index(name)
            shown = SIZE_WORDS.get(name, name.replace("_", " "))
            yield Suspect(
                f"another {shown} of the {system.layout.names[module]} module",
                unit_of(key),
                lane(lambda: at.by_raw, index),
                f"the {shown} of the {system.layout.names[module]} module",
                special=True,
            )


def _seen(at: Fitted) -> Iterator[Suspect]:
    """Yield what may be wrong with markers, hinges and the clock of the camera."""
    names = at.system.layout.names
    for k, name in enumerate(names):
        for ahead, word in ((True, "ahead of"), (False, "aside of")):
            yield Suspect(
                f"the marker of the {name} module {word} its centre", "m",
                at.shown(off(range(k, k + 1), k, ahead)),
                "where the marker is, the places of the hinges of its module, and its wheels",
                special=True,
            )  # fmt: skip
        yield Suspect(
            f"the marker of the {name} module, turned on it", "rad", at.shown(turned(k)),
            "how the marker is stuck on", special=True,
        )  # fmt: skip
        if k + 1 < len(names):
            yield Suspect(
                f"a hinge aside of the middle of the {name} module", "m",
                at.shown(off(range(k + 1, len(names)), k, False)),
                f"where the hinge behind the {name} module is", special=True,
            )  # fmt: skip
    yield at.clock()


def _torques(at: Fitted) -> Iterator[Suspect]:
    """Yield other scales of the torques: of all, of each module, of each motor."""
    layout = at.system.layout
    groups = {"torques": tuple(range(len(layout.motors)))}
    for module in range(layout.modules):
        own = tuple(k for k, item in enumerate(layout.motors) if item.module == module)
        if len(own) > 1 and len(own) < len(layout.motors):
            groups[f"torques of the {layout.names[module]} module"] = own
        if len(layout.motors) > 1:
            groups |= {f"{motor_name(at.system, k)} torque": (k,) for k in own}
    for name, columns in groups.items():
        yield at.scaled(name, columns)


def motor_name(system: ChainSystem, motor: int) -> str:
    """Return the name of a motor: its module, and which wheels it turns."""
    item = system.layout.motors[motor]
    return f"{system.layout.names[item.module]} module's {item.wheels.replace('_', ' ')}"
