"""Defines the physical parameters of the articulated robot, each with unit, bounds and meaning.

Numbers of equations are those of "Modelling and experimental validation of articulated mobile
robots with hybrid locomotion system". All values are held in SI.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, Self

from annotated_types import Ge, Gt, Le, Lt
from pydantic import Field, model_validator

from rigd.sdk import In, ParameterGroup, wrong_entry
from rigd_sim.articulated.layout import STEP_NS

#: Fastest rate times step that is accepted; Runge-Kutta of order 4 is stable up to 2.785.
LARGEST_STEP_RATE: Final = 2.5

Length = Annotated[float, In("m"), Gt(0), Le(5)]
Mass = Annotated[float, In("kg"), Gt(0), Le(500)]
Inertia = Annotated[float, In("kg m^2"), Gt(0), Le(500)]
Share = Annotated[float, In("1"), Ge(0), Lt(1)]
Coefficient = Annotated[float, In("1"), Gt(0), Le(5)]


class Wheels(ParameterGroup):
    """The four wheels of a module, all alike."""

    mass: Annotated[float, In("kg"), Ge(0), Le(50)]
    """Mass m_w of a wheel."""
    spin_inertia: Inertia
    """Inertia I_w of a wheel about its axle."""
    yaw_inertia: Annotated[float, In("kg m^2"), Ge(0), Le(50)]
    """Inertia I_wz of a wheel about its own vertical axis."""
    radius: Annotated[float, In("m"), Gt(0), Le(1)]
    """Radius r_w."""
    pairing: Literal["geared", "single"]
    """Whether the two wheels of a side turn as one, or each by itself."""
    driven: Literal["all", "front", "rear", "none"]
    """Which wheels have a motor; a pair that is geared has one for both."""

    @model_validator(mode="after")
    def _a_pair_has_one_motor(self) -> Self:
        if self.pairing == "geared" and self.driven in ("front", "rear"):
            raise wrong_entry(
                f"driven: {self.driven} needs pairing: single; the motor of a geared pair drives "
                "both wheels",
                "driven",
            )
        return self


class Contact(ParameterGroup):
    """The contact of a module's wheels with the ground (Eqs. 12, 20)."""

    longitudinal: Annotated[float, In("N s/m"), Gt(0), Le(1e5)]
    """Coefficient k_lon, called stiffness in the paper."""
    lateral: Annotated[float, In("N s/m"), Gt(0), Le(1e5)]
    """Coefficient k_lat, called stiffness in the paper."""
    rolling: Annotated[float, In("m"), Ge(0), Le(0.1)]
    """Rolling resistance k_roll: moment over normal force."""
    static: Coefficient | None = None
    """Static coefficient mu_s of these wheels; without it that of the robot's friction."""
    kinetic: Coefficient | None = None
    """Dynamic coefficient mu_d of these wheels; without it that of the robot's friction."""


class Suspension(ParameterGroup):
    """How a module stands on its wheels; used with ``loads: transfer`` and ``vertical`` only."""

    height: Annotated[float, In("m"), Ge(0), Le(2)]
    """Height h of the centre of mass over the ground."""
    stiffness: Annotated[float, In("N/m"), Gt(0), Le(1e9)]
    """Vertical stiffness k_n at each wheel (Eq. 19)."""
    damping: Annotated[float, In("N s/m"), Ge(0), Le(1e5)]
    """Vertical damping at each wheel."""
    roll_inertia: Inertia
    """Inertia of the module about its longitudinal axis."""
    pitch_inertia: Inertia
    """Inertia of the module about its lateral axis."""


class Hinge(ParameterGroup):
    """The stop of a hinge: a moment that pushes back beyond an angle, and never pulls."""

    stop: Annotated[float, In("rad"), Gt(0), Le(3.15)]
    """Angle at which it begins."""
    stiffness: Annotated[float, In("N m/rad"), Ge(0), Le(1e8)]
    """Stiffness."""
    damping: Annotated[float, In("s/rad"), Ge(0), Le(1e3)]
    """Damping as a share of the stiff moment, per speed (Hunt and Crossley 1975)."""


class Drive(ParameterGroup):
    """The motor of a driven wheel or pair, with its speed control."""

    gear_ratio: Annotated[float, In("1"), Gt(0), Le(1000)]
    """Turns of the motor per turn of the wheel, n."""
    rotor_inertia: Annotated[float, In("kg m^2"), Ge(0), Le(1)]
    """Inertia J of the rotor, at the motor."""
    proportional: Annotated[float, In("N m s/rad"), Gt(0), Le(100)]
    """Proportional gain, at the motor."""
    integral: Annotated[float, In("N m/rad"), Ge(0), Le(1000)]
    """Integral gain, at the motor; the integral rests while the torque is limited."""
    torque_limit: Annotated[float, In("N m"), Gt(0), Le(1000)]
    """Largest torque of the motor."""


class Module(ParameterGroup):
    """A module with four wheels at (+-d, +-b)."""

    body_mass: Mass
    """Mass m_j of the body without its wheels."""
    body_inertia: Inertia
    """Yaw inertia I_j of the body without its wheels, about its own centre."""
    half_track: Length
    """Half distance b of right and left wheels."""
    half_wheelbase: Length
    """Half distance d of front and rear wheels."""
    hinge_ahead: Annotated[float, In("m"), Ge(0), Le(5)]
    """Distance from the centre to the hinge ahead; not used of the first module."""
    hinge_behind: Annotated[float, In("m"), Ge(0), Le(5)]
    """Distance from the centre to the hinge behind; not used of the last module."""
    wheels: Wheels
    """The wheels."""
    contact: Contact
    """The contact of the wheels."""
    suspension: Suspension
    """How it stands on its wheels."""
    hinge: Hinge | None = None
    """The stop of the hinge ahead; without it that of the robot. Not used of the first module."""
    drive: Drive | None = None
    """Its motors; without it those of the robot."""

    @property
    def mass(self) -> float:
        """Mass with the wheels in kg, M_j."""
        return self.body_mass + 4 * self.wheels.mass

    @property
    def inertia(self) -> float:
        """Yaw inertia with the wheels in kg m^2, I_j* (articulated.md 2)."""
        arm = self.half_track**2 + self.half_wheelbase**2
        return self.body_inertia + 4 * self.wheels.yaw_inertia + 4 * self.wheels.mass * arm


class Friction(ParameterGroup):
    """Saturation of the contact forces, and what replaces the jumps of the laws."""

    static: Coefficient
    """Static coefficient mu_s."""
    kinetic: Coefficient
    """Dynamic coefficient mu_d."""
    width: Annotated[float, In("1"), Gt(0), Lt(1)]
    """Half width of the blend of ``law: smooth``, as a share of mu_s f_n."""
    rest_speed: Annotated[float, In("rad/s"), Gt(0), Le(10)]
    """Wheel speed of the tanh that replaces the sign of Eq. 12."""

    @model_validator(mode="after")
    def _falls(self) -> Self:
        if self.kinetic > self.static:
            raise wrong_entry(f"kinetic {self.kinetic:g} exceeds static {self.static:g}", "kinetic")
        return self


class Camera(ParameterGroup):
    """The camera over the floor that reads a marker on each module."""

    rate: Annotated[float, In("Hz"), Ge(1), Le(200)]
    """Frames per second."""
    latency: Annotated[float, In("s"), Ge(0), Le(0.5)]
    """Time from the exposure of a frame to its poses."""
    position_noise: Annotated[float, In("m"), Ge(0), Le(0.1)]
    """Noise of each coordinate, rms."""
    heading_noise: Annotated[float, In("rad"), Ge(0), Le(0.5)]
    """Noise of the heading, rms."""
    scale_x: Annotated[float, In("1"), Ge(-0.2), Le(0.2)]
    """Error of the scale along x."""
    scale_y: Annotated[float, In("1"), Ge(-0.2), Le(0.2)]
    """Error of the scale along y, the paper's optical axis."""
    lost: Share
    """Share of frames in which a marker is not found."""
    exchanged: Share
    """Share of frames in which each marker is taken for the next one's."""


class MotorSensors(ParameterGroup):
    """What the drives report."""

    speed_noise: Annotated[float, In("rad/s"), Ge(0), Le(100)]
    """Noise of the motor speed, rms."""
    torque_noise: Annotated[float, In("N m"), Ge(0), Le(10)]
    """Noise of the motor torque, rms."""


class Placing(ParameterGroup):
    """How exactly a person puts the robot at its start."""

    position: Annotated[float, In("m"), Ge(0), Le(0.1)]
    """Scatter of each coordinate, rms."""
    heading: Annotated[float, In("rad"), Ge(0), Le(0.2)]
    """Scatter of each module's heading, rms."""


class ArticulatedParameters(ParameterGroup):
    """Everything physical about the robot."""

    gravity: Annotated[float, In("m/s^2"), Gt(0), Le(30)]
    """Acceleration of gravity."""
    modules: Annotated[dict[str, Module], Field(min_length=1, max_length=8)]
    """The modules by name, from the first to the last of the chain."""
    friction: Friction
    """Saturation of the contacts of modules that have no coefficients of their own."""
    hinge: Hinge
    """The stops of hinges that have none of their own."""
    drive: Drive
    """The motors of modules that have none of their own."""
    camera: Camera
    """The tracker."""
    motor_sensors: MotorSensors
    """What the drives report."""
    placing: Placing
    """How the robot is put at its start."""

    @property
    def mass(self) -> float:
        """Mass of the robot in kg."""
        return sum(module.mass for module in self.modules.values())

    def coefficients(self, module: Module) -> tuple[float, float]:
        """Return mu_s and mu_d of the contacts of ``module``."""
        own, friction = module.contact, self.friction
        static = friction.static if own.static is None else own.static
        return static, friction.kinetic if own.kinetic is None else own.kinetic

    def hinge_ahead(self, module: Module) -> Hinge:
        """Return the stop of the hinge ahead of ``module``."""
        return module.hinge or self.hinge

    def drive_of(self, module: Module) -> Drive:
        """Return the motors of ``module``."""
        return module.drive or self.drive

    def static_load(self, module: Module, *, equal: bool) -> float:
        """Return the normal force of each wheel of ``module`` at rest in N.

        ``equal`` shares the weight of the robot among all wheels, as the paper does.
        """
        if equal:
            return self.gravity * self.mass / (4 * len(self.modules))
        return self.gravity * module.mass / 4

    def fastest_rate(self, module: Module, *, equal: bool = True) -> float:
        """Return the fastest rate of the module's wheels in 1/s (articulated.md 4).

        A declutched pair has r^2 k_lon / I_w from its contact and k_roll f_n / (w_0 I_w) from its
        rolling resistance at rest.
        """
        wheels = module.wheels
        load = self.static_load(module, equal=equal)
        contact = wheels.radius**2 * module.contact.longitudinal
        rolling = module.contact.rolling * load / self.friction.rest_speed
        return (contact + rolling) / wheels.spin_inertia

    @model_validator(mode="after")
    def _contacts_fall(self) -> Self:
        for name, module in self.modules.items():
            static, kinetic = self.coefficients(module)
            if kinetic > static:
                raise wrong_entry(
                    f"kinetic {kinetic:g} of module {name} exceeds its static {static:g}",
                    "modules",
                    name,
                    "contact",
                    "static" if module.contact.kinetic is None else "kinetic",
                )
        return self

    @model_validator(mode="after")
    def _can_be_integrated(self) -> Self:
        for name, module in self.modules.items():
            rate = self.fastest_rate(module)
            largest = LARGEST_STEP_RATE / (STEP_NS * 1e-9)
            if rate > largest:
                raise wrong_entry(
                    f"the wheels of module {name} settle at {rate:.4g} 1/s, too fast for steps of "
                    f"{STEP_NS / 1e3:g} us; at most {largest:.4g} 1/s: lower contact.longitudinal "
                    "or contact.rolling, or give heavier wheels",
                    "modules",
                    name,
                )
        return self

    @model_validator(mode="after")
    def _suspension_can_be_integrated(self) -> Self:
        for name, module in self.modules.items():
            legs = module.suspension
            arms = (
                (1.0, module.mass),
                (module.half_track**2, legs.roll_inertia),
                (module.half_wheelbase**2, legs.pitch_inertia),
            )
            square = max(4 * legs.stiffness * arm / inertia for arm, inertia in arms)
            damping = max(4 * legs.damping * arm / inertia for arm, inertia in arms)
            rate = damping + square**0.5
            if rate > LARGEST_STEP_RATE / (STEP_NS * 1e-9):
                raise wrong_entry(
                    f"module {name} swings on its suspension at {rate:.4g} 1/s, too fast for steps "
                    f"of {STEP_NS / 1e3:g} us; lower its stiffness or damping",
                    "modules",
                    name,
                    "suspension",
                    "stiffness",
                )
        return self

    @model_validator(mode="after")
    def _hinges_can_be_integrated(self) -> Self:
        lightest = min(module.inertia for module in self.modules.values())
        places = {("hinge",): self.hinge} | {
            ("modules", name, "hinge"): module.hinge
            for name, module in self.modules.items()
            if module.hinge is not None
        }
        for place, hinge in places.items():
            rate = (2 * hinge.stiffness / lightest) ** 0.5
            if rate > LARGEST_STEP_RATE / (STEP_NS * 1e-9):
                raise wrong_entry(
                    f"the hinge stop swings the lightest module at {rate:.4g} 1/s, too fast for "
                    f"steps of {STEP_NS / 1e3:g} us; lower {'.'.join(place)}.stiffness",
                    *place,
                    "stiffness",
                )
        return self
