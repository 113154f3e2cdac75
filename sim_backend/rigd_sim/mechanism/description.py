"""Defines the file that describes a mechanism: its bodies, what connects them, drives, sensors.

A body moves along one line (it has a ``mass``) or turns about one axis (``inertia``). Many units
follow from that: a spring between two shafts has N m/rad, any other N/m. Such quantities are text
here; ``assembly.py`` reads them. All start values are those at the start of a run.
"""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal

from annotated_types import Ge, Gt, Le, Len
from pydantic import BeforeValidator, Field, StringConstraints

from rigd.sdk import In, ParameterGroup

Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*$", max_length=40)]
#: A quantity whose unit follows from the bodies that it belongs to; 0 needs none.
Amount = Annotated[str, BeforeValidator(lambda value: str(value) if _plain(value) else value)]
#: Two bodies, or a body and the ground.
Pair = Annotated[tuple[Name, Name], Len(2, 2)]
Radii = Annotated[
    tuple[Annotated[float, In("m"), Gt(0), Le(10)], ...],
    Len(1, 2),
    BeforeValidator(lambda value: value if isinstance(value, list | tuple) else [value]),
]

#: What does not move.
GROUND: Final = "ground"


def _plain(value: object) -> bool:
    return isinstance(value, str | int | float) and not isinstance(value, bool)


class Body(ParameterGroup):
    """What has inertia; with ``mass`` it moves along a line, with ``inertia`` it turns."""

    mass: Annotated[float, In("kg"), Ge(0), Le(1e5)] | None = None
    """Mass of a body that moves along a line."""
    inertia: Annotated[float, In("kg m^2"), Ge(0), Le(1e5)] | None = None
    """Moment of inertia about its axis, of a body that turns."""
    start: Amount = "0"
    """Position or angle at the start."""
    speed: Amount = "0"
    """Speed at the start."""
    slope: Annotated[float, In("rad"), Ge(-math.pi / 2), Le(math.pi / 2)] = 0.0
    """How steeply its way rises: gravity pulls its mass down a slope. 90 deg: it is lifted."""


class Gear(ParameterGroup):
    """A rigid coupling: gear, toothed belt, rack, screw. The two bodies move as one."""

    between: Pair
    """The two bodies that are coupled."""
    ratio: Annotated[float, In("1"), Ge(-1e4), Le(1e4)] | None = None
    """Turns of the first per turn of the second; negative if they turn in opposite directions."""
    radius: Annotated[float, In("m"), Gt(0), Le(10)] | None = None
    """Between a shaft and a body on a line: travel of the body per rad of the shaft."""


class Spring(ParameterGroup):
    """A spring with a damper beside it. Its force is positive in tension.

    Its length is the way of the first body less that of the second; that of a shaft counts at
    ``radius``. It is not strained at the start, but for ``preload``.
    """

    between: Pair
    """The two bodies, or a body and ``ground``."""
    stiffness: Amount
    """N/m, or N m/rad between two shafts."""
    damping: Amount = "0"
    """N s/m, or N m s/rad between two shafts."""
    radius: Radii | None = None
    """Where it acts on a shaft: one radius, or two of an elastic belt between two shafts."""
    preload: Amount = "0"
    """Force in it at the start; negative in compression."""
    play: Amount = "0"
    """Way that it may move without force, as the backlash of a gear."""


class Law(ParameterGroup):
    """How friction depends on speed; with a load all forces are shares of the load.

    viscous: F = c v. coulomb: F = F_c tanh(v / smooth) + c v. stribeck: F_c becomes
    g(v) = F_c + (F_s - F_c) exp(-|v / v_s|^exponent). dahl, lugre: bristles of deflection z,
    dz/dt = v - sigma_0 |v| z / g(v), F = sigma_0 z + sigma_1 dz/dt + c v (Canudas de Wit et al.
    1995, Eqs. 1 to 4); dahl has g = F_c and no sigma_1.
    """

    kind: Literal["viscous", "coulomb", "stribeck", "dahl", "lugre"]
    """Which law."""
    coulomb: Amount | None = None
    """F_c: friction while sliding."""
    static: Amount | None = None
    """F_s: friction at which it breaks away."""
    stribeck_speed: Amount | None = None
    """v_s: speed over which friction falls from F_s to F_c."""
    exponent: Annotated[float, In("1"), Ge(0.5), Le(4)] = 2.0
    """Shape of this fall: 2 as Stribeck's, 1 as Tustin's."""
    viscous: Amount = "0"
    """c: what is added per speed."""
    sigma_0: Amount | None = None
    """Stiffness of the bristles."""
    sigma_1: Amount = "0"
    """Damping of the bristles."""
    smooth: Amount | None = None
    """Speed below which coulomb and stribeck fade, by default 1 mm/s or 1 mrad/s: with these two
    laws a body under load creeps. dahl and lugre hold it."""


class Friction(ParameterGroup):
    """Friction between two bodies: a bearing, a guide, the contact of a pin and a disk."""

    between: Pair
    """The two bodies, or a body and ``ground``."""
    law: Law
    """How it depends on speed."""
    radius: Radii | None = None
    """Where it acts on a shaft; without, friction of a shaft is a torque."""
    load: Amount | None = None
    """Normal force, or the mass of a dead weight: `20 N`, `2 kg`. The law is then in shares of
    it."""
    most_load: Amount | None = None
    """Largest normal force or mass that a person may put on; `changes: NAME_load` of a prompt."""
    pressed_by: Name | None = None
    """In place of ``load``: the spring whose compression is the normal force."""


class Stop(ParameterGroup):
    """Buffers at both ends of a way; they push, never pull."""

    body: Name
    """The body that they stop."""
    low: Amount
    """Where the near one begins."""
    high: Amount
    """Where the far one begins."""
    stiffness: Amount
    """Stiffness of a buffer."""
    damping: Amount = "0"
    """Damping of a buffer."""


class Pendulum(ParameterGroup):
    """A weight at an arm on a shaft; it hangs at angle 0. ``inertia`` of the shaft includes it."""

    body: Name
    """The shaft."""
    mass: Annotated[float, In("kg"), Gt(0), Le(1e4)]
    """Mass of the weight."""
    arm: Annotated[float, In("m"), Gt(0), Le(100)]
    """Distance of its centre from the axis."""


class Drive(ParameterGroup):
    """An actuator between a body and the ground. Without being enabled it gives no force."""

    body: Name
    """The body that it moves."""
    mode: Literal["current", "force", "speed", "position"]
    """What its setpoint is: a current, a force or torque, a speed, a position or angle."""
    limit: Amount
    """Largest current in mode current, else the largest force or torque."""
    torque_constant: Amount | None = None
    """Mode current: N m/A of a motor that turns, N/A of a linear one."""
    bandwidth: Annotated[float, In("Hz"), Ge(1), Le(1e5)] = 1000.0
    """Modes current and force: how fast it follows, as a first order lag."""
    supply: Annotated[float, In("V"), Gt(0), Le(1e4)] | None = None
    """Mode current: voltage that drives it against resistance and back-EMF; by default enough."""
    resistance: Annotated[float, In("ohm"), Gt(0), Le(1e6)] | None = None
    """Mode current: of the winding; needed with ``supply``."""
    speed_limit: Amount | None = None
    """Modes speed and position: its largest speed."""
    gain: Amount | None = None
    """Modes speed and position: force per error of speed."""
    integral: Amount = "0"
    """Modes speed and position: force per integral of the error of speed."""
    position_gain: Annotated[float, In("1/s"), Gt(0), Le(1e4)] | None = None
    """Mode position: demanded speed per error of position."""
    low: Amount | None = None
    """Mode position: smallest setpoint."""
    high: Amount | None = None
    """Mode position: largest setpoint."""


class Temperature(ParameterGroup):
    """A part that friction warms: rise = power times resistance, with one time constant."""

    heated_by: Annotated[tuple[Name, ...], Len(1, 8)]
    """The friction whose power warms it."""
    share: Annotated[float, In("1"), Gt(0), Le(1)] = 1.0
    """Share of the power that goes into this part."""
    capacity: Annotated[float, In("J/K"), Gt(0), Le(1e6)]
    """Its heat capacity."""
    resistance: Annotated[float, In("K/W"), Gt(0), Le(1e6)]
    """Thermal resistance to the air."""


class Sensor(ParameterGroup):
    """What is measured of a body, an element or a part, with the errors of the instrument."""

    measures: Literal["position", "speed", "force", "torque", "load", "temperature", "current"]
    """``force`` and ``torque`` are those in a spring, friction or drive, ``load`` presses a
    friction element, ``current`` is that of a drive."""
    of: Name
    """The body, spring, friction, drive or temperature."""
    low: Amount
    """Smallest reading; it stays there beyond."""
    high: Amount
    """Largest reading."""
    noise: Amount = "0"
    """Standard deviation of white noise on each reading."""
    resolution: Amount = "0"
    """Step between readings, as a count of an encoder; 0: none."""
    zero: Amount = "0"
    """Reading where the quantity is 0."""
    bandwidth: Annotated[float, In("Hz"), Gt(0), Le(1e6)] | None = None
    """First order low pass before the reading; by default none."""


class Description(ParameterGroup):
    """The parts of a mechanism, which ``assembly.py`` puts together."""

    bodies: Annotated[dict[Name, Body], Len(1, 16)]
    """The bodies by name; ``ground`` is there without being listed."""
    gears: Annotated[dict[Name, Gear], Len(0, 15)] = Field(default_factory=dict)
    """Rigid couplings."""
    springs: Annotated[dict[Name, Spring], Len(0, 32)] = Field(default_factory=dict)
    """Springs and dampers."""
    friction: Annotated[dict[Name, Friction], Len(0, 32)] = Field(default_factory=dict)
    """Friction of bearings, guides and contacts."""
    stops: Annotated[dict[Name, Stop], Len(0, 16)] = Field(default_factory=dict)
    """End stops."""
    pendulums: Annotated[dict[Name, Pendulum], Len(0, 16)] = Field(default_factory=dict)
    """Weights on shafts."""
    drives: Annotated[dict[Name, Drive], Len(0, 16)] = Field(default_factory=dict)
    """Actuators."""
    temperatures: Annotated[dict[Name, Temperature], Len(0, 16)] = Field(default_factory=dict)
    """Parts that get warm."""
    sensors: Annotated[dict[Name, Sensor], Len(0, 64)] = Field(default_factory=dict)
    """Sensors."""
    gravity: Annotated[float, In("m/s^2"), Ge(0), Le(30)] = 9.81
    """Acceleration of gravity."""
    ambient: Annotated[float, In("K"), Gt(0), Le(2000)] = 293.15
    """Temperature of the air, and of every part at the start."""
    step: Annotated[float, In("s"), Ge(2e-6), Le(1e-3)] = 62.5e-6
    """Longest step of the integrator. It is shorter if something is faster; a longer one than the
    default makes long runs faster, and less exact."""
