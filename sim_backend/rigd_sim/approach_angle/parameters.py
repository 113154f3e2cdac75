"""Defines the physical parameters of the approach-angle rig with unit, bounds and meaning.

All values are held in SI. A *spread* is a standard deviation: between individual rigs, or, if the
parameter's text states it, from run to run.
"""

from __future__ import annotations

import math
from typing import Annotated, Self

from annotated_types import Ge, Gt, Le, Lt
from pydantic import model_validator

from rigd.sdk import In, ParameterGroup, wrong_entry
from rigd_sim.approach_angle.layout import SETS, STEPS_PER_S
from rigd_sim.approach_angle.sensor_parameters import (
    Arm,
    Card,
    Gauges,
    LoadCell,
    Potentiometers,
    Scale,
)

#: Spring rates (rad/s) and rates of decay (1/s) that the explicit integrator can take.
FASTEST_PER_S = 1.5 * STEPS_PER_S

Share = Annotated[float, In("1"), Ge(0), Le(0.2)]
Coefficient = Annotated[float, In("1"), Ge(0), Le(2)]
Length = Annotated[float, In("m"), Gt(0), Le(2)]
Time = Annotated[float, In("s"), Gt(0), Le(5)]


class Motor(ParameterGroup):
    """The DC motor with its gearbox, as seen at the gearbox's output."""

    back_emf: Annotated[float, In("V s/rad"), Gt(0), Le(10)]
    """Back-EMF; also torque per current, before the gearbox's losses."""
    efficiency: Annotated[float, In("1"), Gt(0), Le(1)]
    """Efficiency of the gearbox."""
    resistance: Annotated[float, In("ohm"), Gt(0), Le(100)]
    """Resistance of the winding."""
    source_resistance: Annotated[float, In("ohm"), Ge(0), Le(100)]
    """Resistance of regulator, wiring and relay."""
    inductance: Annotated[float, In("H"), Gt(0), Le(1)]
    """Inductance of the winding."""
    rotor_inertia: Annotated[float, In("kg m^2"), Gt(0), Le(10)]
    """Inertia of the rotor, at the output."""
    gearbox_drag: Annotated[float, In("N m"), Ge(0), Le(10)]
    """Dry drag, upstream of the gauges."""

    @property
    def torque_per_current(self) -> float:
        """Torque at the output per current, in N m/A."""
        return self.efficiency * self.back_emf

    @model_validator(mode="after")
    def _can_be_integrated(self) -> Self:
        rate = (self.resistance + self.source_resistance) / self.inductance
        if rate > FASTEST_PER_S:
            raise wrong_entry(
                f"the winding's rate {rate:.3g} 1/s (resistance over inductance) is too fast for "
                f"{STEPS_PER_S} steps a second; at most {FASTEST_PER_S:.3g} 1/s",
                "resistance",
            )
        return self


class Relay(ParameterGroup):
    """The relay between voltage regulator and motor."""

    pick_up: Annotated[float, In("s"), Ge(0), Le(0.1)]
    """Time from the command to close to the first contact."""
    bounce: Annotated[float, In("s"), Ge(0), Le(0.02)]
    """Time during which the contact bounces."""
    drop_out: Annotated[float, In("s"), Ge(0), Le(0.1)]
    """Time from the command to open to the open contact."""
    brake: bool
    """Whether a contact shorts the motor while the relay is open; otherwise it coasts."""


class Shaft(ParameterGroup):
    """The shaft between gearbox and wheel, which carries the gauges."""

    radius: Length
    """Radius at the gauges."""
    shear_modulus: Annotated[float, In("Pa"), Gt(1e9), Le(1e12)]
    """Shear modulus."""
    youngs_modulus: Annotated[float, In("Pa"), Gt(1e9), Le(1e12)]
    """Young's modulus."""
    poisson: Annotated[float, In("1"), Ge(0), Lt(0.5)]
    """Poisson's ratio."""
    stiffness: Annotated[float, In("N m/rad"), Gt(0), Le(1e5)]
    """Torsional stiffness, with the coupling."""
    damping: Annotated[float, In("N m s/rad"), Ge(0), Le(10)]
    """Torsional damping."""
    backlash: Annotated[float, In("rad"), Ge(0), Le(0.2)]
    """Half the gap of gearbox and coupling."""
    bend_arm: Annotated[float, In("m"), Ge(0), Le(1)]
    """Bending moment at the gauges per load of the wheel."""
    rigidity_spread: Share
    """Spread of the true torsional rigidity."""

    @property
    def rigidity(self) -> float:
        """Nominal torsional rigidity G J, in N m^2."""
        return self.shear_modulus * math.pi / 2 * self.radius**4

    @property
    def bending_stiffness(self) -> float:
        """Bending stiffness E I, in N m^2."""
        return self.youngs_modulus * math.pi / 4 * self.radius**4


class Wheel(ParameterGroup):
    """The omni-wheel and its bearings, downstream of the gauges."""

    radius: Annotated[float, In("m"), Ge(0.005), Le(0.5)]
    """Nominal radius R."""
    effective_radius: Annotated[float, In("1"), Gt(0.9), Lt(1.1)]
    """Effective rolling radius over the nominal one."""
    inertia: Annotated[float, In("kg m^2"), Gt(0), Le(1)]
    """Inertia of wheel and shaft about the axle."""
    rollers: Annotated[int, Ge(1), Le(50)]
    """Rollers on each of the two sides."""
    roller_drag: Coefficient
    """Axial drag of the free rollers over the load, mu_a."""
    rolling_resistance: Coefficient
    """Moment of rolling resistance over load and nominal radius, C_rr."""
    bearing_constant: Annotated[float, In("N m"), Ge(0), Le(1)]
    """b0 of the bearings' friction b0 + b1 |w| + bN N."""
    bearing_viscous: Annotated[float, In("N m s/rad"), Ge(0), Le(0.1)]
    """b1."""
    bearing_load: Annotated[float, In("m"), Ge(0), Le(0.1)]
    """bN, in N m per N."""


class Platform(ParameterGroup):
    """The platform that the wheel drives along its rails."""

    mass: Annotated[float, In("kg"), Gt(0.1), Le(50)]
    """Mass with the contact plate."""
    stop: Length
    """Travel at which a run is stopped."""
    back: Annotated[float, In("m"), Ge(-1), Lt(0)]
    """Where the near bumper begins."""
    bumper: Length
    """Where the far bumper begins."""
    bumper_stiffness: Annotated[float, In("N/m"), Gt(0), Le(1e6)]
    """Stiffness of a bumper."""
    bumper_damping: Annotated[float, In("N s/m"), Ge(0), Le(1e4)]
    """Damping of a bumper."""
    rail_constant: Annotated[float, In("N"), Ge(0), Le(100)]
    """c0 of the rails' drag c0 + c_N (|N - m g| + |F_y|) + c_v V."""
    rail_load: Coefficient
    """c_N."""
    rail_viscous: Annotated[float, In("N s/m"), Ge(0), Le(100)]
    """c_v."""

    @model_validator(mode="after")
    def _bumper_beyond_the_stop(self) -> Self:
        if self.bumper <= self.stop:
            raise wrong_entry(
                f"bumper {self.bumper:g} m must lie beyond stop {self.stop:g} m: a run would never "
                "reach its stop",
                "bumper",
            )
        return self


class NormalForce(ParameterGroup):
    """How the normal force departs from the load that was set."""

    setting_spread: Share
    """Spread of the load that the bolts set, from setting to setting."""
    rise: Annotated[float, In("1"), Ge(-0.5), Le(0.5)]
    """Relative rise over the travel to the stop."""
    rise_spread: Share
    """Spread of the rise, from run to run."""
    tilting: Annotated[float, In("1"), Ge(0), Le(0.5)]
    """Normal force per traction force."""
    relaxation: Share
    """Relative relaxation of the surface during a run."""
    relaxation_time: Time
    """Time constant of the relaxation."""
    vertical_mode: Annotated[float, In("Hz"), Gt(0.1), Le(500)]
    """Frequency of the platform on the surface."""
    vertical_damping: Annotated[float, In("1"), Ge(0), Le(2)]
    """Damping of that mode, over the critical one."""
    profile_rollers: Annotated[float, In("m"), Ge(0), Le(0.01)]
    """Amplitude of the wheel's profile at every roller of both sides."""
    profile_sides: Annotated[float, In("m"), Ge(0), Le(0.01)]
    """Amplitude of the wheel's profile from side to side."""


class Contact(ParameterGroup):
    """The friction between wheel and surface: bristles that rolling carries away."""

    peak_speed: Annotated[float, In("m/s"), Gt(0), Le(10)]
    """Sliding speed at which friction is largest."""
    hump: Coefficient
    """Curvature of the friction over the decade of the sliding speed."""
    speed_floor: Annotated[float, In("m/s"), Gt(0), Le(0.1)]
    """Floor of the logarithm's argument."""
    stiffness: Annotated[float, In("1/m"), Gt(0), Le(1e4)]
    """Stiffness of the bristles per load."""
    damping: Annotated[float, In("s/m"), Ge(0), Le(10)]
    """Damping of the bristles per load."""
    damping_speed: Annotated[float, In("m/s"), Gt(0), Le(10)]
    """Sliding speed at which the damping fades."""
    convection: Annotated[float, In("1/m"), Ge(0), Le(1e4)]
    """How rolling carries bent bristles out of the contact, per length rolled."""
    breakaway: Coefficient
    """Relative surplus of friction after a dwell."""
    breakaway_slide: Length
    """Sliding distance over which the surplus decays."""
    scatter: Share
    """Spread of the surface from run to run."""


class Limits(ParameterGroup):
    """Largest F_r/N of each set."""

    clean_0: Annotated[float, In("1"), Gt(0.02), Le(2)]
    """Clean wheel at 0 deg."""
    clean_15: Annotated[float, In("1"), Gt(0.02), Le(2)]
    """Clean wheel at 15 deg."""
    clean_30: Annotated[float, In("1"), Gt(0.02), Le(2)]
    """Clean wheel at 30 deg."""
    clean_45: Annotated[float, In("1"), Gt(0.02), Le(2)]
    """Clean wheel at 45 deg."""
    coated_0: Annotated[float, In("1"), Gt(0.02), Le(2)]
    """Coated wheel at 0 deg; no other angle is published."""

    def of(self, angle_deg: float, wheel: str) -> float | None:
        """Return the limit of ``wheel`` at an angle, or None if none is published."""
        for name, known in SETS.items():
            if known == (angle_deg, wheel):
                return float(getattr(self, name))
        return None


class AngleParameters(ParameterGroup):
    """Everything physical about the rig."""

    gravity: Annotated[float, In("m/s^2"), Gt(0), Le(30)]
    """Acceleration of gravity."""
    motor: Motor
    """Motor and gearbox."""
    relay: Relay
    """The relay."""
    shaft: Shaft
    """The shaft with the gauges."""
    wheel: Wheel
    """The wheel and its bearings."""
    platform: Platform
    """The platform on its rails."""
    normal_force: NormalForce
    """How the normal force varies."""
    contact: Contact
    """Friction between wheel and surface."""
    limits: Limits
    """Largest friction of each set."""
    gauges: Gauges
    """The strain gauges."""
    potentiometers: Potentiometers
    """The potentiometers."""
    scale: Scale
    """The scale."""
    load_cell: LoadCell
    """The optional load cell."""
    card: Card
    """The data acquisition card."""
    calibration_arm: Arm
    """The arm for calibration."""

    @model_validator(mode="after")
    def _springs_can_be_integrated(self) -> Self:
        shaft, wheel, platform = self.shaft, self.wheel, self.platform
        for name, stiffness, inertia in (
            ("shaft.stiffness", shaft.stiffness, wheel.inertia),
            ("platform.bumper_stiffness", platform.bumper_stiffness, platform.mass),
        ):
            if math.sqrt(stiffness / inertia) > 0.2 * STEPS_PER_S:
                stiffest = inertia * (0.2 * STEPS_PER_S) ** 2
                raise wrong_entry(
                    f"{name} {stiffness:g} is too stiff for {STEPS_PER_S} steps a second; "
                    f"at most {stiffest:.3g}",
                    *name.split("."),
                )
        return self
