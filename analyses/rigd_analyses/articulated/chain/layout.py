"""Which modules, motors and constants a plan of a chain names, checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from rigd.analysis import DataError
from rigd.analysis.parameters import Trials
from rigd.analysis.recordings.source import RecordedSweep
from rigd.analysis.result import FloatArray
from rigd_analyses.articulated.chain.needs import (
    AXES,
    HINGES,
    KINDS,
    MOST_MODULES,
    NUMBERS,
    OF_MODULE,
    WHEELS,
    of_module,
)
from rigd_analyses.articulated.evaluation import common_constant
from rigd_analyses.articulated.reading import RobotSignals

NAMES: Final = ("first", "second", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
#: Constants of a module that the simulation takes, in the order of :meth:`Layout.keys`.
SIZES: Final = (
    "wheel_radius", "half_track", "half_wheelbase", "hinge_ahead", "hinge_behind", "body_mass",
    "body_inertia", "wheel_mass", "wheel_inertia",
)  # fmt: skip


@dataclass(frozen=True)
class Motor:
    """A motor of module ``module`` (from 0), and which ``wheels`` of it turns: one of WHEELS."""

    module: int
    wheels: str

    @property
    def side(self) -> int:
        """Return 0 if its wheels are right, 1 if they are left."""
        return WHEELS[self.wheels][0]

    @property
    def count(self) -> int:
        """Return how many wheels it turns."""
        return WHEELS[self.wheels][1]

    def signal(self, name: str) -> str:
        """Return the name of its signal ``speed`` or ``torque``."""
        return of_module(self.module + 1, f"{self.wheels}_{name}")


@dataclass(frozen=True)
class Layout:
    """A chain of ``modules`` with ``motors``; ``stated`` are the constants of single modules."""

    modules: int
    motors: tuple[Motor, ...]
    stated: frozenset[str] = frozenset()

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the modules, from the first."""
        return NAMES[: self.modules]

    @property
    def signals(self) -> RobotSignals:
        """Return the names of what is read."""
        return RobotSignals(
            tuple(motor.signal("speed") for motor in self.motors),
            tuple(motor.signal("torque") for motor in self.motors),
            tuple(of_module(k + 1, axis) for k in range(self.modules) for axis in AXES),
            self.names,
        )

    @cached_property
    def driven(self) -> FloatArray:
        """Return how many wheels of the right and the left side of each module have a motor."""
        found = np.zeros((self.modules, 2))
        for motor in self.motors:
            found[motor.module, motor.side] += motor.count
        return found

    def of_kind(self, kind: str) -> tuple[int, ...]:
        """Return the modules (from 0) that have a contact parameter of a kind.

        A wheel without a motor rolls: nothing shows its k_lon.
        """
        return tuple(
            k for k in range(self.modules) if kind != "k_lon" or np.any(self.driven[k] > 0.0)
        )

    @property
    def contacts(self) -> tuple[tuple[str, int], ...]:
        """Return kind and module (from 0) of all contact parameters."""
        return tuple((kind, k) for kind in KINDS for k in self.of_kind(kind))

    def key(self, module: int, name: str) -> str:
        """Return the constant that has a size of a module; empty if it has no such hinge."""
        ends = {"hinge_ahead": module == 0, "hinge_behind": module == self.modules - 1}
        if ends.get(name, False):
            return ""
        wanted = [name, "hinge_distance"] if name in HINGES else [name]
        for item in wanted:
            if of_module(module + 1, item) in self.stated:
                return of_module(module + 1, item)
        return wanted[-1]

    @property
    def keys(self) -> tuple[tuple[str, ...], ...]:
        """Return the constants (n, SIZES) of each module."""
        return tuple(tuple(self.key(k, name) for name in SIZES) for k in range(self.modules))


def layout_of(trials: Trials) -> Layout:
    """Return the chain that the plans of all ``trials`` name.

    Raises:
        DataError: they name modules or motors otherwise than `modules` and `motors` state, not all
            signals of one, or nothing drives.
    """
    sweeps = list({sweep.path: sweep for sweep, _ in trials}.values())
    modules, motors = (_whole(trials, name) for name in ("modules", "motors"))
    if not 1 <= modules <= MOST_MODULES:
        raise DataError(
            f"{sweeps[0].path}: `modules` is {modules}, must be 1 to {MOST_MODULES}",
            hint="correct it under `identify: constants:` in the procedure",
        )
    if motors < 1:
        raise DataError(
            f"{sweeps[0].path}: `motors` is {motors}: no module is driven, and the speeds of "
            "motors are the input of the model",
            hint="give the speeds and torques of its motors under `identify: signals:`, and their "
            "number under `identify: constants:`",
        )
    found = [_layout(sweep, modules, motors) for sweep in sweeps]
    if any(item != found[0] for item in found):
        other = next(k for k, item in enumerate(found) if item != found[0])
        raise DataError(
            f"{sweeps[other].path} names other motors, or constants of single modules, than "
            f"{sweeps[0].path}",
            hint="identify each rig with a command of its own",
        )
    return found[0]


def _whole(trials: Trials, name: str) -> int:
    value = common_constant(trials, name)
    if not (np.isfinite(value) and value == round(value)):
        raise DataError(
            f"{trials[0][0].path}: `{name}` is {value:g}, must be a whole number",
            hint="correct it under `identify: constants:` in the procedure",
        )
    return round(value)


def _layout(sweep: RecordedSweep, modules: int, motors: int) -> Layout:
    given = sweep.plan.signals
    wanted = [of_module(k, axis) for k in range(1, modules + 1) for axis in AXES]
    _refuse_missing(sweep, f"`modules` is {modules}", "modules", wanted)
    beyond = [
        of_module(k, axis) for k in NUMBERS for axis in AXES
        if k > modules and of_module(k, axis) in given
    ]  # fmt: skip
    if beyond:
        raise DataError(
            f"{sweep.path}: `modules` is {modules}, but there are signals of more: "
            f"{', '.join(beyond)}",
            hint="correct `modules` under `identify: constants:` in the procedure",
        )
    every = [Motor(k - 1, wheels) for k in NUMBERS for wheels in WHEELS]
    found = [item for item in every if item.signal("speed") in given]
    torques = [item.signal("torque") for item in found]
    _refuse_missing(sweep, "each motor needs its torque", "motors", torques)
    if len(found) != motors or found[-1].module >= modules:
        shown = ", ".join(item.signal("speed") for item in found) or "none"
        raise DataError(
            f"{sweep.path}: `motors` is {motors}, but the recording has the speeds of "
            f"{len(found)} on modules 1 to {modules}: {shown}",
            hint="record the streams of all motors (`record` in the procedure), and name them "
            "under `identify: signals:`; or correct `motors` under `identify: constants:`",
        )
    layout = Layout(
        modules, tuple(found), frozenset(name for name in sweep.plan.constants if _of_one(name))
    )
    if np.any(layout.driven > 2.0):
        at = int(np.argmax(np.max(layout.driven, axis=1)))
        raise DataError(
            f"{sweep.path}: more than two wheels of one side of module {at + 1} have a motor",
            hint="name either `right` and `left`, of wheels that are geared together, or single "
            "wheels",
        )
    if modules > 1 and "" in {*_lengths(layout, sweep)}:
        raise DataError(
            f"{sweep.path}: the constant 'hinge_distance' is not known",
            hint="give it under `identify: constants:` in the procedure",
        )
    return layout


def _lengths(layout: Layout, sweep: RecordedSweep) -> list[str]:
    """Return the constants of all hinges; empty texts for those that the plan does not give."""
    keys = [
        layout.key(k, name)
        for k in range(layout.modules)
        for name in ("hinge_ahead", "hinge_behind")
    ]
    return [key if key in sweep.plan.constants else "" for key in keys if key]


def _of_one(name: str) -> bool:
    """Return whether a constant is that of a single module."""
    return name.startswith("module_") and name[9:] in {**OF_MODULE, **HINGES}


def _refuse_missing(sweep: RecordedSweep, why: str, constant: str, wanted: Sequence[str]) -> None:
    missing = [name for name in wanted if name not in sweep.plan.signals]
    if missing:
        raise DataError(
            f"{sweep.path}: {why}, but the recording has no {', '.join(missing)}",
            hint="name them under `identify: signals:` and their streams under `record` in the "
            f"procedure; or correct `{constant}` under `identify: constants:`",
        )
