"""Lists what may be wrong with markers, camera and torques of a robot of any number of modules.

Each suspect is the change of the outputs for each unit of it, at the fitted motion.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np

from rigd.analysis.output_error.score import Columns
from rigd.analysis.output_error.structure import Context, ErrorSource, Suspect
from rigd.analysis.result import FloatArray
from rigd_analyses.articulated.robot import RecordedRobot


class Motion(Protocol):
    """The simulation of a trial: ``pose`` and ``rate`` (n, 3 modules)."""

    @property
    def pose(self) -> FloatArray:
        """Return x, y and heading of each module."""

    @property
    def rate(self) -> FloatArray:
        """Return the rates of :attr:`pose`."""


SystemT = TypeVar("SystemT", bound=RecordedRobot)
RunT = TypeVar("RunT", bound=Motion)
Respond = Callable[[Motion, FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class FittedMotion(ABC, Generic[SystemT, RunT]):
    """A fitted motion and how things that the model does not have would change it."""

    system: SystemT
    theta: FloatArray

    @property
    def shared(self) -> FloatArray:
        """Return the shared parameters (p,)."""
        return self.theta[: len(self.system.shared)]

    def local(self, trial: int) -> FloatArray:
        """Return the local parameters of one trial."""
        width = len(self.system.local)
        first = len(self.system.shared) + width * trial
        return np.asarray(self.theta[first : first + width])

    @cached_property
    def runs(self) -> list[RunT]:
        """Return the simulation of each trial."""
        return [self.simulated(k) for k in range(len(self.system.trials))]

    @abstractmethod
    def simulated(self, trial: int) -> RunT:
        """Return the simulation of one trial."""

    def shown(self, respond: Respond) -> Callable[[], Columns]:
        """Return outputs by changes (n, 3 modules) of the poses in the frame of the simulation.

        ``respond`` gives them from a simulation and the times (n,) in s of its frames.
        """
        return lambda: [
            self.system.seen(k, respond(run, item.t_s)[:, :, None], self.shared, self.local(k))
            for k, (run, item) in enumerate(zip(self.runs, self.system.trials, strict=True))
        ]

    def scaled(self, name: str, columns: Sequence[int]) -> Suspect:
        """Return another scale of the torques in ``columns``, which have a ``name`` together."""

        def respond() -> Columns:
            made = []
            for k in range(len(self.system.trials)):
                # Not the measured ones, whose noise the residuals have too.
                torques = self.system.simulate(k, self.shared, self.local(k))
                out = np.zeros((*torques.shape, 1))
                out[:, columns, 0] = torques[:, columns]
                made.append(out)
            return made

        return Suspect(
            f"another scale of the {name}", "1", respond, "the torque constants of the motors, the "
            "losses of the gears", special=True,
        )  # fmt: skip

    def clock(self) -> Suspect:
        """Return a clock of the camera that gains."""
        return Suspect(
            "a clock of the camera that gains", "1",
            self.shown(lambda run, t_s: np.asarray(run.rate * t_s[:, None])),
            "the clocks of camera and drives", special=True,
        )  # fmt: skip

    def sources(self) -> list[ErrorSource]:
        """Return the readings in which an error may enter."""
        width, m = len(self.system.outputs), self.system.motors

        def reading(columns: range) -> Callable[[int, FloatArray], FloatArray]:
            def respond(trial: int, signals: FloatArray) -> FloatArray:
                out = np.zeros((len(signals), width, signals.shape[1]))
                for column in columns:
                    out[:, column] = signals
                return out

            return respond

        return [
            ErrorSource("an error of the camera along x", "m", reading(range(m, width, 3))),
            ErrorSource("an error of the camera along y", "m", reading(range(m + 1, width, 3))),
            ErrorSource("an error of the headings", "rad", reading(range(m + 2, width, 3))),
            ErrorSource("an error of the torques", "N m", reading(range(m))),
        ]

    def contexts(self, hinges: Sequence[str]) -> list[Context]:
        """Return what an error may depend on; ``hinges`` are the words for the angle of each."""
        trials, runs = self.system.trials, self.runs
        turned = [float(np.sign(np.round(run.pose[-1, 2]))) for run in runs]
        headings = [
            run.pose[:, 2] + self.system.turn(k, self.local(k)) for k, run in enumerate(runs)
        ]
        return [
            Context("the time in a trial", [item.t_s for item in trials]),
            Context("the place along x", [item.poses[:, 0] for item in trials]),
            Context("the place along y", [item.poses[:, 1] for item in trials]),
            Context("the heading", headings, round_rad=True),
            *(
                Context(words, [run.pose[:, 3 * k + 2] - run.pose[:, 3 * k + 5] for run in runs])
                for k, words in enumerate(hinges)
            ),
            Context("the sense of turning",
                    [np.full(len(item.poses), sign)
                     for item, sign in zip(trials, turned, strict=True)],
                    groups=True),
        ]  # fmt: skip


def lane(parts: Callable[[], list[FloatArray]], index: int) -> Callable[[], Columns]:
    """Return one lane of the changes (n, outputs, lanes) of each trial."""
    return lambda: [np.ascontiguousarray(part[:, :, index : index + 1]) for part in parts()]


def off(modules: Sequence[int], on: int, ahead: bool) -> Respond:
    """Return how markers of ``modules`` move that are off along or across module ``on``."""

    def respond(run: Motion, _: FloatArray) -> FloatArray:
        out = np.zeros_like(run.pose)
        c, s = np.cos(run.pose[:, 3 * on + 2]), np.sin(run.pose[:, 3 * on + 2])
        for k in modules:
            out[:, 3 * k], out[:, 3 * k + 1] = (c, s) if ahead else (-s, c)
        return out

    return respond


def turned(module: int) -> Respond:
    """Return how the marker of a module moves that is turned on it."""

    def respond(run: Motion, _: FloatArray) -> FloatArray:
        out = np.zeros_like(run.pose)
        out[:, 3 * module + 2] = 1.0
        return out

    return respond
