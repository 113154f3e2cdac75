"""Lists possible errors of the model of the robot beyond its constants.

Each has a name, or is a dependence of a reading on some quantity, and is given as the change of the
outputs for each unit of it, at the fitted motion. What acts on the robot goes along with one
simulation of each trial, a lane for each thing.
"""

from __future__ import annotations

from collections.abc import Iterator
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
from rigd_analyses.articulated.kernel import DISTURBED, LANES
from rigd_analyses.articulated.suspects import FittedMotion, lane, off, turned
from rigd_analyses.articulated.system import SHARED, RobotSystem, Run

RUBBING_RAD_S: Final = 0.02  #: rate of the hinge over which its friction changes its sign
SIDE: Final = np.array([-1.0, 1.0, -1.0, 1.0])  #: of the front wheels, left is 1
END: Final = np.array([1.0, 1.0, -1.0, -1.0])  #: front is 1
#: What to look at if a marker of a module is off. A hinge that is off on the rear module moves the
#: rear marker like a marker that is off there.
PLACES: Final = {
    "front": "where the marker is, and its wheels",
    "rear": "where the marker is, the hinge's place on the rear module, and its wheels",
}
#: Places in what disturbs a robot (:mod:`.kernel`).
RIGHT, LEFT, ALONG, ACROSS, TURN, REAR_ACROSS, REAR_TURN = range(DISTURBED)


@dataclass(frozen=True)
class Acting:
    """Something that acts on the robot: its lane, wording and what it makes of the parameters."""

    name: str
    unit: str
    look: str
    meaning: Meaning = Meaning.NUISANCE
    possible: tuple[float, float] = ANY


ACTING: Final = (
    Acting("another radius of the right wheels", "1", "the diameters of the wheels on both sides"),
    Acting("a hinge that springs back", "N m/rad", "cables across the hinge, and its stop",
           possible=POSITIVE),
    Acting("a hinge that rubs", "N m", "the bearing of the hinge", possible=POSITIVE),
    Acting("drag with the square of the speed", "N s^2/m^2", "cables that the robot pulls",
           possible=POSITIVE),
    Acting("longitudinal forces that are not in proportion to the slip", "s/m",
           "another law of the contacts", Meaning.LAW),
    Acting("lateral forces that are not in proportion to the lateral speed", "s/m",
           "another law of the contacts", Meaning.LAW),
    Acting("another k_lat of the rear module", "1", "the tyres of both modules", Meaning.VARIES),
    Acting("loads that shift with the forces, by a height", "m",
           "the height of the centre of mass: the model takes the loads as equal", Meaning.LAW,
           POSITIVE),
    Acting("contacts that change in the course of a trial", "1/s", "tyres and floor: wear, dirt",
           Meaning.VARIES),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Moved(FittedMotion[RobotSystem, Run]):
    """A fitted motion and how things that the model does not have would change it."""

    @cached_property
    def named(self) -> dict[str, float]:
        """Return the shared parameters by name."""
        return dict(zip(SHARED, self.shared.tolist(), strict=True))

    def simulated(self, trial: int) -> Run:
        """Return the simulation of one trial."""
        return self.system.run(trial, self.shared, self.local(trial))

    @cached_property
    def acted(self) -> list[FloatArray]:
        """Return the changes (n, 8, LANES) of the outputs of each trial by ACTING."""
        found = []
        for k in range(len(self.system.trials)):
            disturbed = self._disturbed(k)
            run = self.system.run(
                k, self.shared, self.local(k), moving=True, disturbed=disturbed
            )  # fmt: skip
            lanes = self.system.outputs_of(k, run, self.shared, self.local(k))
            rolled = self.system.mean_torque(k, run.torque)[:, 0] / self.system.gear_ratio
            lanes[:, 0, 0] += rolled  # a larger wheel needs more torque for its force
            found.append(lanes)
        return found

    def _disturbed(self, trial: int) -> FloatArray:
        """Return what disturbs a trial for a unit of each of ACTING, (m, DISTURBED, LANES)."""
        item, run, named = self.system.trials[trial], self.runs[trial], self.named
        b, d = named["half_track"], named["half_wheelbase"]
        load = (named["body_mass"] + 4.0 * named["wheel_mass"]) * named["gravity"] / 4.0
        count = len(run.pose)
        frames = np.zeros((count, DISTURBED, LANES))
        hinge = run.pose[:, 2] - run.pose[:, 5]
        rate = run.rate[:, 2] - run.rate[:, 5]
        for index, moment in ((1, -hinge), (2, -np.tanh(rate / RUBBING_RAD_S))):
            frames[:, TURN, index], frames[:, REAR_TURN, index] = moment, -moment
        c, s = np.cos(run.pose[:, 2]), np.sin(run.pose[:, 2])
        forward = run.rate[:, 0] * c + run.rate[:, 1] * s
        frames[:, ALONG, 3] = -forward * np.abs(forward)
        lon, lat = run.forces[:, :4, 0], run.forces[:, :4, 1]
        rear = run.forces[:, 4:, 1]

        def wheels(index: int, along: FloatArray, across: FloatArray, behind: FloatArray) -> None:
            """Add forces of the front wheels (n, 4) and of a wheel of both rear axles (n, 2)."""
            frames[:, ALONG, index] = np.sum(along, axis=1)
            frames[:, ACROSS, index] = np.sum(across, axis=1)
            frames[:, TURN, index] = across @ (d * END) - along @ (b * SIDE)
            frames[:, REAR_ACROSS, index] = 2.0 * np.sum(behind, axis=1)
            frames[:, REAR_TURN, index] = 2.0 * d * (behind[:, 0] - behind[:, 1])

        none, none_behind = np.zeros_like(lon), np.zeros_like(rear)
        wheels(4, lon * np.abs(lon) / named["k_lon"], none, none_behind)
        k_lat = named["k_lat"]
        wheels(5, none, lat * np.abs(lat) / k_lat, rear * np.abs(rear) / k_lat)
        wheels(6, none, none, rear)
        total_lon, total_lat = lon.sum(axis=1)[:, None], lat.sum(axis=1)[:, None]
        shifted = -(SIDE * total_lat / b + END * total_lon / d) / (4.0 * load)
        # Both wheels of a rear axle have one force: what one gains in load the other loses.
        wheels(7, lon * shifted, lat * shifted, none_behind)
        since = item.t_s[:, None]
        wheels(8, lon * since, lat * since, rear * since)
        nodes = item.grid / item.period_s
        at = np.arange(count)
        flat = frames.reshape(count, -1)
        used = np.flatnonzero(np.any(flat != 0.0, axis=0))
        out = np.zeros((len(nodes), DISTURBED * LANES))
        for column in used:
            out[:, column] = np.interp(nodes, at, flat[:, column])
        disturbed = out.reshape(len(nodes), DISTURBED, LANES)
        disturbed[:, RIGHT, 0] = item.speeds[:, 0] / self.system.gear_ratio
        return disturbed


def candidates(system: RobotSystem, theta: FloatArray) -> Iterator[Suspect]:
    """Yield what may be wrong, at the parameters ``theta`` (p,) of ``system``."""
    moved = Moved(system, theta)
    for index, thing in enumerate(ACTING):
        yield Suspect(
            thing.name, thing.unit, lane(lambda: moved.acted, index), thing.look, special=True,
            meaning=thing.meaning, possible=thing.possible,
        )  # fmt: skip
    yield from _markers(moved)
    yield from dependences(moved.sources(), moved.contexts(["the hinge's angle"]))


def _markers(moved: Moved) -> Iterator[Suspect]:
    """Yield what may be wrong with a marker, the camera's clock or the torques."""
    yield moved.scaled("torques", (0, 1))
    yield moved.scaled("right torque", (0,))
    for k, module in enumerate(("front", "rear")):
        for ahead, word in ((True, "ahead of"), (False, "aside of")):
            yield Suspect(
                f"a {module} marker {word} the centre of its module", "m",
                moved.shown(off((k,), k, ahead)), PLACES[module], special=True,
            )  # fmt: skip
        yield Suspect(
            f"a {module} marker that is turned on its module", "rad", moved.shown(turned(k)),
            "how the marker is stuck on", special=True,
        )  # fmt: skip
    for ahead, word in ((True, "ahead of its place on"), (False, "aside of the middle of")):
        yield Suspect(
            f"a hinge {word} the front module", "m", moved.shown(off((1,), 0, ahead)),
            "where the hinge is on the front module", special=True,
        )  # fmt: skip
    yield moved.clock()
