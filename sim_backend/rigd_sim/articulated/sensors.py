"""Simulates the camera tracker of the articulated robot, and gives its true states."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, ClassVar, TypeVar

from annotated_types import Ge, Le

from rigd.sdk import Channel, Declaration, DriverConfig, In, PlantSensor, ProtocolError, Row
from rigd_sim.articulated import layout
from rigd_sim.articulated.camera import Camera
from rigd_sim.articulated.plant import ArticulatedPlant


class ModuleConfig(DriverConfig):
    """Which module."""

    module: str
    """Name of the module in the parameter file."""


ModuleConfigT = TypeVar("ModuleConfigT", bound=ModuleConfig)


class OfModule(PlantSensor[ModuleConfigT, ArticulatedPlant]):
    """A sensor of one module."""

    def __init__(self, config: ModuleConfigT, link: ArticulatedPlant) -> None:
        super().__init__(config, link)
        self._module = 0

    def open(self) -> None:
        """Find the module.

        Raises:
            ProtocolError: the robot has no such module.

        """
        try:
            self._module = self.link.number(self.config.module)
        except ValueError as error:
            raise ProtocolError(str(error), hint="the parameter file lists the modules") from error
        self.identity = f"simulated, {self.link.laws}"


class PoseRow(Row):
    """The marker of a module in a frame."""

    x: float
    y: float
    heading: float
    frame: float


class ArticulatedTracker(OfModule[ModuleConfig]):
    """The marker on a module's centre as the camera over the floor sees it.

    The camera takes frame k at k / rate from the origin of time, and gives the pose of a marker
    its latency later: that is when the row comes. A frame in which the marker was not found gives
    none. In an exchanged frame each marker is taken for the next module's.
    """

    Config: ClassVar[type[DriverConfig]] = ModuleConfig
    title: ClassVar[str] = "camera tracker of the simulated articulated robot"

    def __init__(self, config: ModuleConfig, link: ArticulatedPlant) -> None:
        super().__init__(config, link)
        self._camera = Camera(link)
        self._seen = -1

    @classmethod
    def declare(cls, config: ModuleConfig) -> Declaration:
        """Return the pose, which comes at the camera's pace."""
        return Declaration(
            channels=(
                Channel("x", "m", "position of the marker by the camera", -50.0, 50.0),
                Channel("y", "m", "position of the marker by the camera", -50.0, 50.0),
                Channel("heading", "rad", "heading of the marker, -pi to pi", -math.pi, math.pi),
                Channel("frame", "count", "number of the frame by the camera's own count"),
            ),
            row=PoseRow,
            every_cycle=False,
            silent_s=2.5,
        )

    def read(self, t_ns: int) -> PoseRow | None:
        """Return the newest pose, None while there is no new one."""
        plant = self.link
        plant.advance(t_ns)
        camera = plant.parameters.camera
        since_s = (t_ns - plant.origin_ns) * 1e-9 - camera.latency
        frame = math.floor(since_s * camera.rate + 1e-6)
        if frame <= self._seen:
            return None
        pose = self._camera.true_pose(self._module, frame, frame / camera.rate)
        if pose is None:
            return None
        self._seen = frame
        found = self._camera.measured(self._module, frame, pose)
        if found is None:
            return None
        x, y, heading = found
        return PoseRow.of(x=x, y=y, heading=heading, frame=float(frame))


class TruthConfig(ModuleConfig):
    """Which module, and how often."""

    period: Annotated[float, In("s"), Ge(0), Le(1)] = 0.0
    """Time between two rows; 0: one in every cycle."""


class ArticulatedTruth(OfModule[TruthConfig]):
    """The hidden state of a module, for verification; no real rig has it."""

    Config: ClassVar[type[DriverConfig]] = TruthConfig
    title: ClassVar[str] = "hidden state of a module of the simulated articulated robot"

    def __init__(self, config: TruthConfig, link: ArticulatedPlant) -> None:
        super().__init__(config, link)
        self._seen = -1

    @classmethod
    def declare(cls, config: TruthConfig) -> Declaration:
        """Return the hidden state that the plant lists."""
        return Declaration(
            channels=tuple(Channel(name, unit, doc) for name, unit, doc in layout.TRUTH),
            plain_rows=True,
            every_cycle=config.period == 0.0,
            silent_s=0.1 + 5 * config.period,
        )

    def read(self, t_ns: int) -> Sequence[float] | None:
        """Return the hidden state in the order of ``layout.TRUTH``, None before it is due."""
        self.link.advance(t_ns)
        if self.config.period > 0.0:
            since_s = (t_ns - self.link.origin_ns) * 1e-9
            due = math.floor(since_s / self.config.period + 1e-6)
            if due == self._seen:
                return None
            self._seen = due
        return self.link.truth(self._module)
