"""Defines the physical parameters of the LuGre rig, each with unit, bounds and meaning.

Numbers of equations are those of "Investigation of longitudinal friction characteristics of an
omnidirectional wheel via LuGre model". All values are held in SI.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from annotated_types import Ge, Gt, Le, Lt
from pydantic import model_validator

from rigd.sdk import In, ParameterGroup, wrong_entry
from rigd_sim.lugre.layout import STEP_NS

#: Gain 2 |s| c / j of the loop between lateral force and row loads at which it is refused; at 1
#: the rollers would lock themselves (Eqs. 22, 25, 26 lose their solution).
LARGEST_LOOP_GAIN: Final = 0.9

Coefficient = Annotated[float, In("1"), Ge(0), Le(2)]
Length = Annotated[float, In("m"), Gt(0), Le(2)]
Arm = Annotated[float, In("m"), Ge(-1), Le(1)]


class EndStops(ParameterGroup):
    """Spring and damper at either end of a travel; they push, never pull."""

    low: Annotated[float, In("m")]
    """Where the near buffer begins."""
    high: Annotated[float, In("m")]
    """Where the far buffer begins."""
    stiffness: Annotated[float, In("N/m"), Gt(0), Le(1e6)]
    """Stiffness of a buffer."""
    damping: Annotated[float, In("N s/m"), Ge(0), Le(1e4)]
    """Damping of a buffer."""

    @model_validator(mode="after")
    def _around_the_start(self) -> Self:
        if not self.low < 0 < self.high:
            raise wrong_entry(
                f"low {self.low:g} m and high {self.high:g} m must lie on either side of the "
                "start at 0 m",
                "low",
            )
        return self


class Guide(ParameterGroup):
    """Friction of the linear guide and the arms of the moment on it (Eqs. 21 to 24)."""

    dry: Coefficient
    """Dry friction coefficient."""
    viscous: Annotated[float, In("s/m"), Ge(0), Le(10)]
    """Viscous friction coefficient, times the normal force."""
    contact_arm: Arm
    """Arm d of the wheel's contact force about D."""
    mass_arm: Arm
    """Arm e of the weight about D."""
    half_span: Length
    """Half distance h of the reactions."""
    height: Length
    """Height c of D over the floor."""


class Carriage(ParameterGroup):
    """The quarter model that the wheel drives along the guide."""

    mass: Annotated[float, In("kg"), Ge(0.5), Le(20)]
    """Mass m_T."""
    guide: Guide
    """The linear guide."""
    end_stops: EndStops
    """Ends of the travel along the guide."""


class Rollers(ParameterGroup):
    """Friction of the passive rollers in lateral motion (Eqs. 25 and 26)."""

    dry: Coefficient
    """Dry friction coefficient."""
    viscous: Annotated[float, In("s/m"), Ge(0), Le(1)]
    """Viscous friction coefficient, times the normal force."""
    row_distance: Length
    """Distance j of the two rows."""
    mass_offset: Arm
    """Offset k of the centre of mass; between the rows, in (-j, 0)."""
    coupling: Literal["paper", "physical", "none"]
    """What a lifted row contributes: |F_r| as printed, nothing, or no lateral force at all."""

    @model_validator(mode="after")
    def _mass_between_rows(self) -> Self:
        if not -self.row_distance < self.mass_offset < 0:
            raise wrong_entry(
                f"mass_offset {self.mass_offset:g} m must lie between the rows, within "
                f"({-self.row_distance:g}, 0) m; outside, one row is lifted at rest",
                "mass_offset",
            )
        return self


class Bearings(ParameterGroup):
    """Friction of the wheel's bearings (Eqs. 48 and 49)."""

    dry: Coefficient
    """Dry friction coefficient."""
    viscous: Annotated[float, In("s/rad"), Ge(0), Le(0.1)]
    """Viscous friction coefficient, times the normal force."""
    pitch_diameter: Length
    """Pitch diameter p_d."""
    spacing: Length
    """Distance a of the bearings."""
    overhang: Annotated[float, In("m"), Ge(0), Le(1)]
    """Overhang b of the wheel."""


class Wheel(ParameterGroup):
    """The omni-wheel."""

    radius: Annotated[float, In("m"), Ge(0.005), Le(0.5)]
    """Rolling radius r."""
    inertia: Annotated[float, In("kg m^2"), Gt(0), Le(1)]
    """Moment of inertia I_3."""
    roller_transitions: Annotated[int, Ge(0), Le(200)]
    """Transitions between rollers per revolution."""
    force_ripple: Annotated[float, In("1/s"), Ge(0), Le(10)]
    """Amplitude of the force on the carriage by transitions, per mass and speed."""
    rollers: Rollers
    """The passive rollers."""
    bearings: Bearings
    """The bearings of the wheel shaft."""


class Drive(ParameterGroup):
    """Motor, gear and current-mode amplifier (Eqs. 45 to 47, 51)."""

    supply: Annotated[float, In("V"), Gt(0), Le(100)]
    """Supply voltage."""
    torque_constant: Annotated[float, In("N m/A"), Gt(0), Le(1)]
    """Torque constant K_t."""
    back_emf: Annotated[float, In("V s/rad"), Gt(0), Le(1)]
    """Back-EMF constant K_e."""
    resistance: Annotated[float, In("ohm"), Gt(0), Le(1000)]
    """Terminal resistance R."""
    bandwidth: Annotated[float, In("Hz"), Ge(10), Le(1e5)]
    """Bandwidth of the current loop."""
    rated_current: Annotated[float, In("A"), Gt(0), Le(100)]
    """Current that the drive must be able to carry at half of its no-load speed."""
    current_limit: Annotated[float, In("A"), Gt(0), Le(100)]
    """The amplifier's own limit."""
    no_load_dry: Annotated[float, In("N m"), Ge(0), Le(1)]
    """Dry no-load torque at the motor shaft."""
    no_load_viscous: Annotated[float, In("N m s/rad"), Ge(0), Le(0.1)]
    """Viscous no-load torque at the motor shaft."""
    rotor_inertia: Annotated[float, In("kg m^2"), Gt(0), Le(0.1)]
    """Inertia J_r of the rotor."""
    gear_inertia: Annotated[float, In("kg m^2"), Ge(0), Le(0.1)]
    """Inertia J_g of the gear at the motor shaft."""
    gear_ratio: Annotated[float, In("1"), Ge(1), Le(1000)]
    """Turns of the motor per turn of the wheel, G_r."""
    efficiency: Annotated[float, In("1"), Gt(0), Le(1)]
    """Efficiency E of the gear."""

    @model_validator(mode="after")
    def _can_carry_the_rated_current(self) -> Self:
        largest = self.supply / (2 * self.rated_current)
        if self.resistance > largest:
            carried = self.supply / (2 * self.resistance)
            raise wrong_entry(
                f"resistance {self.resistance:g} ohm leaves {carried:.3g} A at half of the "
                f"no-load speed, less than rated_current {self.rated_current:g} A; "
                f"at most {largest:.3g} ohm can work on {self.supply:g} V",
                "resistance",
            )
        if self.rated_current > self.current_limit:
            raise wrong_entry(
                f"rated_current {self.rated_current:g} A exceeds current_limit "
                f"{self.current_limit:g} A",
                "rated_current",
            )
        return self


class Bridge(ParameterGroup):
    """What carries the guide across the rig (Eqs. 18, 19, 27)."""

    mass: Annotated[float, In("kg"), Gt(0), Le(200)]
    """Mass m_11."""
    rail_dry: Coefficient
    """Dry friction coefficient of the rails."""
    rail_viscous: Annotated[float, In("s/m"), Ge(0), Le(10)]
    """Viscous friction coefficient of the rails, times the normal force."""
    end_stops: EndStops
    """Ends of the travel across the guide."""


class Belt(ParameterGroup):
    """Speed servo of one belt: proportional and integral, limited in force."""

    proportional: Annotated[float, In("N s/m"), Gt(0), Le(1e4)]
    """Proportional gain."""
    integral: Annotated[float, In("N/m"), Ge(0), Le(1e5)]
    """Integral gain."""
    force_limit: Annotated[float, In("N"), Gt(0), Le(1e4)]
    """Largest force."""
    speed_limit: Annotated[float, In("m/s"), Gt(0), Le(5)]
    """Largest speed the servo accepts."""


class Belts(ParameterGroup):
    """The two belt drives."""

    longitudinal: Belt
    """Along the guide: brakes the carriage and brings it back."""
    lateral: Belt
    """Across the guide: moves the bridge."""


class Floor(ParameterGroup):
    """LuGre parameters of one floor (Eqs. 4 to 6, table I) and its rolling resistance."""

    stribeck_speed: Annotated[float, In("m/s"), Gt(0), Le(100)]
    """Stribeck speed V_s."""
    mu_coulomb: Annotated[float, In("1"), Gt(0), Le(3)]
    """Kinetic friction coefficient mu_c."""
    mu_static: Annotated[float, In("1"), Gt(0), Le(3)]
    """Static friction coefficient mu_s."""
    sigma_0: Annotated[float, In("1/m"), Gt(0), Le(1e4)]
    """Stiffness of the bristles per normal force."""
    sigma_1: Annotated[float, In("s/m"), Ge(0), Le(10)]
    """Damping of the bristles per normal force."""
    sigma_2: Annotated[float, In("s/m"), Ge(0), Le(100)]
    """Viscous friction per normal force."""
    rolling: Annotated[float, In("1"), Ge(0), Lt(0.5)]
    """Coefficient of rolling resistance (Eq. 20)."""

    @model_validator(mode="after")
    def _static_not_below_kinetic(self) -> Self:
        if self.mu_static < self.mu_coulomb:
            raise wrong_entry(
                f"mu_static {self.mu_static:g} is below mu_coulomb {self.mu_coulomb:g}", "mu_static"
            )
        return self


class Floors(ParameterGroup):
    """The three floors of the paper."""

    stone: Floor
    """Natural stone."""
    pvc: Floor
    """PVC floor covering."""
    paperboard: Floor
    """Paperboard laid on the floor."""


class Accelerometer(ParameterGroup):
    """Accelerometer on the carriage."""

    sensitivity: Annotated[float, In("V s^2/m"), Gt(0), Le(10)]
    """Volts per acceleration."""
    noise: Annotated[float, In("m/s^2"), Ge(0), Le(10)]
    """Noise, rms per sample."""
    bias: Annotated[float, In("m/s^2"), Ge(-10), Le(10)]
    """Reading at rest."""
    gain: Annotated[float, In("1"), Gt(0.5), Lt(2)]
    """True over nominal sensitivity."""
    shake: Annotated[float, In("1/s"), Ge(0), Le(10)]
    """Amplitude felt by the sensor alone at twice the transitions, per speed."""


class CurrentMonitor(ParameterGroup):
    """Analogue current monitor of the amplifier."""

    sensitivity: Annotated[float, In("V/A"), Ge(-10), Le(10)]
    """Volts per ampere; negative if the monitor is inverted."""
    noise: Annotated[float, In("A"), Ge(0), Le(1)]
    """Noise, rms per sample."""
    zero: Annotated[float, In("A"), Ge(-1), Le(1)]
    """Reading at no current."""


class Sensors(ParameterGroup):
    """Encoders, card, accelerometer, current monitor and the drives' own measurements."""

    motor_counts: Annotated[float, In("count/rad"), Gt(0)]
    """Counts of the encoder on the motor shaft."""
    guide_resolution: Annotated[float, In("m/count"), Gt(0), Le(0.01)]
    """Travel per count of the measuring wheel."""
    card_resolution: Annotated[float, In("V"), Gt(0), Le(1)]
    """One bit of the data acquisition card; its range is +-10 V."""
    accelerometer: Accelerometer
    """The accelerometer."""
    current_monitor: CurrentMonitor
    """The current monitor."""
    belt_position: Annotated[float, In("m"), Gt(0), Le(0.01)]
    """Resolution of the belts' encoders."""
    belt_speed: Annotated[float, In("m/s"), Gt(0), Le(0.1)]
    """Resolution of the speed that a belt drive reports."""
    belt_force: Annotated[float, In("N"), Gt(0), Le(10)]
    """Resolution of the force that a belt drive reports."""


class LugreParameters(ParameterGroup):
    """Everything physical about the rig."""

    gravity: Annotated[float, In("m/s^2"), Gt(0), Le(30)]
    """Acceleration of gravity."""
    carriage: Carriage
    """The quarter model on its guide."""
    wheel: Wheel
    """The omni-wheel."""
    drive: Drive
    """Motor, gear and amplifier."""
    bridge: Bridge
    """What moves across the rig."""
    belts: Belts
    """The belt drives."""
    floors: Floors
    """The floors that can be laid."""
    sensors: Sensors
    """What is measured."""

    @model_validator(mode="after")
    def _lateral_loop_does_not_lock(self) -> Self:
        rollers, speed = self.wheel.rollers, self.belts.lateral.speed_limit
        friction = rollers.dry + rollers.viscous * speed
        gain = 2 * friction * self.carriage.guide.height / rollers.row_distance
        if rollers.coupling == "paper" and gain >= LARGEST_LOOP_GAIN:
            raise wrong_entry(
                f"loop gain 2 s c / j = {gain:.3g} of the lateral force reaches "
                f"{LARGEST_LOOP_GAIN} at belts.lateral.speed_limit {speed:g} m/s, where the "
                "rollers would lock; lower the speed limit or the friction of wheel.rollers",
                "belts",
                "lateral",
                "speed_limit",
            )
        return self

    @model_validator(mode="after")
    def _end_stops_can_be_integrated(self) -> Self:
        for name, stops, mass in (
            ("carriage", self.carriage.end_stops, self.carriage.mass),
            ("bridge", self.bridge.end_stops, self.carriage.mass + self.bridge.mass),
        ):
            stiffest = mass * (0.5e9 / STEP_NS) ** 2
            if stops.stiffness > stiffest:
                raise wrong_entry(
                    f"{name}.end_stops.stiffness {stops.stiffness:g} N/m on {mass:g} kg is too "
                    f"fast for steps of {STEP_NS / 1e3:g} us; at most {stiffest:.3g} N/m",
                    name,
                    "end_stops",
                    "stiffness",
                )
        return self
