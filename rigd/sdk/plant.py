"""Defines the base class of plants: the physics of a simulated rig, advanced by the rig's clock."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from rigd.sdk.options.documented_model import Documented
from rigd.sdk.setting import Setting


class PlantConfig(Documented):
    """The options of one plant in a rig file: frozen, every key known, every field documented."""

    def settings(self) -> Mapping[str, Setting]:
        """Return what the operator can change at the bench, by the name in prompts.

        An option of the same name is its value at the start. ``rigd check`` refuses rig files and
        procedures that name other settings.

        Raises:
            ConfigError: the file that contains them is wrong.
        """
        return {}

    def files(self) -> Mapping[Path, str]:
        """Return path and text of the files, beyond the rig file, from which the plant is made.

        They are attached to recordings, and checked by ``rigd check``.

        Raises:
            ConfigError: one of them is wrong.
        """
        return {}

    def attachments(self) -> Mapping[str, str]:
        """Return further texts that explain the plant, by the name that recordings give them."""
        return {}

    def at_start(self) -> Mapping[str, float | str]:
        """Return the values that the options give to settings, by name; a number is in SI."""
        values = {name: getattr(self, name, None) for name in self.settings()}
        return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True)
class Energy:
    """The energy of a plant in J; the last two fields are totals since counting began.

    Only the difference of two calls of :meth:`Plant.energy` counts: a plant may begin at the first,
    so that a run, which asks for none, does not pay for it.
    """

    stored: float  #: in motion, springs, height: what the plant could still give back
    supplied: float  #: by the actuators; falls while the plant drives them
    dissipated: float  #: by friction, in windings, in buffers; never falls


class Plant(ABC):
    """The physics that the simulated devices of one rig share.

    Constructed as ``Plant(config, period_ns=..., seed=...)``. The same seed and the same commands
    at the same times give the same samples bit for bit. An author writes :meth:`evolve`, and
    :meth:`apply` if ``Config`` names settings that a person can change at the bench.

    Raises:
        ValueError: an option gives a setting a value that it does not take.

    """

    Config: ClassVar[type[PlantConfig]] = PlantConfig
    #: One line for a person: which rig this is the physics of.
    title: ClassVar[str] = ""
    #: Longest step of the integrator in ns; None if the plant has no such number.
    step_ns: ClassVar[int | None] = None
    #: The error of the hidden state falls as the step to this power.
    order: ClassVar[int] = 1
    #: Whether what devices show depends on the seed.
    seeded: ClassVar[bool] = True

    def __init__(self, config: Any, *, period_ns: int, seed: int) -> None:
        self.config = config
        self.period_ns = period_ns
        #: What noise and scatter are drawn from; another one from each trial on.
        self.seed = seed
        #: The time of the first call of :meth:`advance`, and the present time of the plant.
        self.origin_ns = self.now_ns = 0
        #: Whether :meth:`advance` was called.
        self.begun = False
        self._settings = config.settings()
        for name, value in config.at_start().items():
            self._settings[name].accepted(name, value)

    def advance(self, t_ns: int) -> None:
        """Bring the physics to ``t_ns`` with the inputs held since the last call.

        A second call with the same time does nothing; the first call sets the origin of time.

        Raises:
            ValueError: ``t_ns`` is before the last call.
        """
        if not self.begun:
            self.origin_ns = self.now_ns = t_ns
            self.begun = True
        elif t_ns == self.now_ns:
            return
        elapsed_ns = t_ns - self.now_ns
        if elapsed_ns < 0:
            raise ValueError(f"the plant is at {self.now_ns} ns and cannot go back to {t_ns}")
        self.evolve(t_ns - self.origin_ns, elapsed_ns)
        self.now_ns = t_ns

    @abstractmethod
    def evolve(self, t_ns: int, elapsed_ns: int) -> None:
        """Advance the physics by ``elapsed_ns``, to ``t_ns`` since the origin of time.

        The first call is that of ``t_ns`` 0, with nothing elapsed: sensors show the start.
        """

    def begin_trial(self, seed: int) -> None:
        """Draw noise and scatter from ``seed``, that of a trial, from now on; nothing else changes.

        A trial then draws the same numbers in every run that plays it. An author who counts what
        was drawn begins the count anew here.
        """
        self.seed = seed

    def change(self, quantity: str, value: float | str) -> None:
        """Change one of the settings; a number is in SI.

        Raises:
            ValueError: the plant has no such ``quantity``, or refuses ``value`` (now).
        """
        if quantity not in self._settings:
            known = ", ".join(self._settings) or "nothing"
            raise ValueError(f"this plant has no {quantity!r}; it can change {known}")
        self.apply(quantity, self._settings[quantity].accepted(quantity, value))

    def apply(self, quantity: str, value: float | str) -> None:
        """Set one of the settings to an accepted value, from now on.

        Raises:
            ValueError: the state of the bench does not permit it; the message states the reason.
        """
        raise NotImplementedError(f"{type(self).__name__} has settings, and no apply()")

    def energy(self) -> Energy | None:
        """Return the energies now; None: the plant does not count them."""
        return None


class GridPlant(Plant):
    """A plant that is integrated in steps of ``step_ns``, counted from the origin of time.

    The division of time into calls of :meth:`advance` then changes nothing, bit for bit: between
    two points of the grid the state is that of the first point.
    """

    step_ns: ClassVar[int] = 125_000

    def __init__(self, config: Any, *, period_ns: int, seed: int) -> None:
        super().__init__(config, period_ns=period_ns, seed=seed)
        #: Steps taken.
        self.steps = 0

    def evolve(self, t_ns: int, elapsed_ns: int) -> None:
        """Take the steps up to ``t_ns``."""
        due = t_ns // self.step_ns
        while self.steps < due:
            self.step(self.step_ns * 1e-9)
            self.steps += 1

    @abstractmethod
    def step(self, step_s: float) -> None:
        """Integrate over one step, in s, with the inputs held."""
