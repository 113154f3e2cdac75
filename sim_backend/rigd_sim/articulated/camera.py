"""Simulates what a camera over the floor makes of the markers on the modules of the robot."""

from __future__ import annotations

import math
from typing import Final

from rigd_sim.articulated.plant import ArticulatedPlant

#: Added to the seed of a plant: the draws of the frames, and of each marker in them.
FRAME_SEED: Final = 1 << 42
MARKER_SEED: Final = 1 << 43

#: x and y in m, heading in rad.
Pose = tuple[float, float, float]


class Camera:
    """The camera of ``plant``, which errs as the parameters have it; without noise it does not.

    What it draws depends on frame and marker alone, not on the order in which they are asked for.
    """

    def __init__(self, plant: ArticulatedPlant) -> None:
        self._plant = plant

    def true_pose(self, module: int, frame: int, at_s: float) -> Pose | None:
        """Return the pose of what is taken for a module's marker, ``at_s`` after the origin.

        In an exchanged frame that is the next module. None: see :meth:`ArticulatedPlant.pose`.
        """
        plant = self._plant
        exchanged = plant.parameters.camera.exchanged * plant.config.noise
        if _uniform(_draws(plant.seed + FRAME_SEED, frame)[0]) < exchanged:
            module = (module + 1) % len(plant.modules)
        return plant.pose(module, at_s)

    def measured(self, module: int, frame: int, pose: Pose) -> Pose | None:
        """Return ``pose`` as the camera measures it; None if it does not find the marker."""
        plant, (x, y, heading) = self._plant, pose
        camera = plant.parameters.camera
        if plant.config.noise:
            seed = plant.seed + MARKER_SEED * (1 + module)
            draws = (*_draws(seed, 2 * frame), *_draws(seed, 2 * frame + 1))
            if _uniform(draws[3]) < camera.lost:
                return None
            x = (1.0 + camera.scale_x) * x + camera.position_noise * draws[0]
            y = (1.0 + camera.scale_y) * y + camera.position_noise * draws[1]
            heading += camera.heading_noise * draws[2]
        return x, y, math.remainder(heading, 2 * math.pi)


def _draws(seed: int, index: int) -> tuple[float, float]:
    """Return two standard normal numbers; compiled code is imported when a rig plays."""
    from rigd.sdk.noise import normal_pair

    return normal_pair(seed, index)


def _uniform(normal: float) -> float:
    """Return the number in (0, 1) that a standard normal number stands for."""
    return 0.5 * (1.0 + math.erf(normal / math.sqrt(2.0)))
