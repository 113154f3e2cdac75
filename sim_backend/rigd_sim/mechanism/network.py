"""Defines a mechanism in numbers: degrees of freedom, elements between them, sensors; all in SI.

Every element acts along one strain ``e = a x_i + b x_j + offset`` of one or two degrees of freedom.
Its force F (N, or N m if the strain is an angle) acts on them by ``-a F`` and ``-b F``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Final

#: What steps of the integrator are a whole part of, in ns.
STEP_NS: Final = 1_000_000


class Kind(IntEnum):
    """What an element is; the kernel has the same numbers."""

    SPRING = 0
    CONSTANT = 1
    PENDULUM = 2
    STOP = 3
    SLIDING = 4  #: viscous, coulomb, stribeck: a function of speed alone
    BRISTLES = 5  #: dahl, lugre
    CURRENT = 6  #: and force: a current of torque constant 1
    SPEED = 7
    POSITION = 8


class Measure(IntEnum):
    """What a sensor shows; the kernel has the same numbers."""

    POSITION = 0
    SPEED = 1
    FORCE = 2
    LOAD = 3
    TEMPERATURE = 4
    CURRENT = 5


#: Words of the description, and what the kernel knows; a torque is a force times its radius.
MEASURES: Final = {
    "position": Measure.POSITION,
    "speed": Measure.SPEED,
    "force": Measure.FORCE,
    "torque": Measure.FORCE,
    "load": Measure.LOAD,
    "temperature": Measure.TEMPERATURE,
    "current": Measure.CURRENT,
}


@dataclass(frozen=True)
class Axis:
    """Where a body is: ``start + factor * x[dof]``, in m, or in rad if it turns."""

    name: str
    dof: int
    factor: float
    start: float
    turns: bool

    @property
    def unit(self) -> str:
        """SI unit of its position."""
        return "rad" if self.turns else "m"


@dataclass(frozen=True)
class End:
    """One end of an element: a degree of freedom, and the strain per unit of it."""

    dof: int
    lever: float


@dataclass(frozen=True)
class Element:
    """One element; ``numbers`` are the fields of the kernel's record that differ from 0."""

    name: str
    kind: Kind
    ends: tuple[End, ...]
    numbers: Mapping[str, float]
    force_unit: str
    strain_unit: str
    offset: float = 0.0
    #: Normal force that multiplies a friction law; 1 without.
    load: float = 1.0
    #: Name of the spring whose compression is the normal force.
    pressed_by: str = ""
    #: Largest load that a person may put on, in ``load_unit``; 0: it cannot be changed.
    most_load: float = 0.0
    #: kg for a dead weight, N for a force.
    load_unit: str = "N"
    #: Radius of its first shaft, for torques; 0: none.
    radius: float = 0.0
    #: Force in it at the start, in the unit of forces.
    at_start: float = 0.0
    #: Setpoints of a drive.
    low: float = 0.0
    high: float = 0.0
    setpoint_unit: str = ""


@dataclass(frozen=True)
class Warm:
    """A part with a temperature."""

    name: str
    heated_by: tuple[int, ...]
    rise: float  #: K/W that counts: share times resistance
    rate: float  #: 1/s


@dataclass(frozen=True)
class Instrument:
    """A sensor; ``index`` is that of the body, element or warm part."""

    name: str
    measure: Measure
    index: int
    unit: str
    factor: float
    low: float
    high: float
    noise: float
    resolution: float
    zero: float
    bandwidth: float  #: Hz; 0: none


@dataclass(frozen=True)
class Mechanism:
    """The whole; elements stand so that each comes after the spring that presses it."""

    masses: tuple[float, ...]  #: kg or kg m^2 of each degree of freedom
    speeds: tuple[float, ...]  #: at the start
    axes: Mapping[str, Axis]
    elements: tuple[Element, ...]
    warm: tuple[Warm, ...]
    instruments: tuple[Instrument, ...]
    gravity: float
    ambient: float
    #: Steps of the integrator in :data:`STEP_NS`.
    parts: int
    index: Mapping[str, int] = field(default_factory=dict)  #: of elements, by name

    def element(self, name: str) -> Element:
        """Return the element ``name``."""
        return self.elements[self.index[name]]

    @property
    def drives(self) -> tuple[Element, ...]:
        """The drives, in the order of their commands."""
        return tuple(item for item in self.elements if item.kind >= Kind.CURRENT)

    def instrument(self, name: str) -> int:
        """Return the number of the sensor ``name``."""
        return [item.name for item in self.instruments].index(name)
