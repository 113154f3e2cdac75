"""Holds the constants of the rig that are known before a trial, each with its uncertainty."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from rigd.analysis import DataError
from rigd.analysis.estimates import Share

#: Unit of each constant, and whether it may be zero.
CONSTANTS = {
    "mass": ("kg", False),
    "wheel_radius": ("m", False),
    "guide_friction": ("N", True),
    "rolling_resistance": ("", True),
    "gravity": ("m/s^2", False),
    "torque_constant": ("N m/A", False),
    "gear_ratio": ("", False),
    "gear_efficiency": ("", False),
    "no_load_torque": ("N m", True),
    "no_load_viscous": ("N m s/rad", True),
    "motor_inertia": ("kg m^2", True),
    "wheel_inertia": ("kg m^2", False),
    "bearing_torque": ("N m", True),
    "roller_transitions": ("per turn", True),
    "guide_lift": ("N", True),
}
#: The same units as rigd reads them; a number per turn has none.
UNITS = {name: "1" if unit in ("", "per turn") else unit for name, (unit, _) in CONSTANTS.items()}


@dataclass(frozen=True)
class Known:
    """A value and its standard uncertainty ``u``, both in the same unit."""

    value: float
    u: float


NOTHING = Known(0.0, 0.0)


@dataclass(frozen=True)
class RigConstants:
    """Constants in SI. ``guide_friction`` is that at ``mass``; the rest as in lugre.md section 3.

    ``bearing_torque`` is the dry torque of the wheel's bearings under the load at hand,
    ``guide_lift`` the force of the guide that lifts the carriage off its wheel, of either sign.
    """

    mass: Known
    wheel_radius: Known
    guide_friction: Known
    rolling_resistance: Known
    gravity: Known
    torque_constant: Known
    gear_ratio: Known
    gear_efficiency: Known
    no_load_torque: Known
    no_load_viscous: Known
    motor_inertia: Known
    wheel_inertia: Known
    bearing_torque: Known
    roller_transitions: float
    guide_lift: Known = NOTHING

    def __post_init__(self) -> None:
        """Check each constant.

        Raises:
            DataError: a constant, or its uncertainty, is none that a rig can have.
        """
        for field in fields(self):
            known = getattr(self, field.name)
            value, u = (known.value, known.u) if isinstance(known, Known) else (known, 0.0)
            unit, may_be_zero = CONSTANTS[field.name]
            if field.name != "guide_lift" and not (
                math.isfinite(value) and (value > 0.0 or (may_be_zero and value == 0.0))
            ):
                least = "must be 0 or more" if may_be_zero else "must be above 0"
                raise _refused(f"{field.name} is {value:g} {unit}".rstrip() + f", {least}")
            if not (math.isfinite(u) and u >= 0.0):
                raise _refused(f"the uncertainty of {field.name} is {u:g}, must be 0 or more")
        refuse_lift(self.guide_lift.value, self.mass.value * self.gravity.value)
        if self.gear_efficiency.value > 1.0:
            raise _refused(f"gear_efficiency is {self.gear_efficiency.value:g}, must be at most 1")

    @property
    def normal_force_n(self) -> float:
        """Return the load on the wheel in N: m_T g of Eq. 25, less the lift of the guide."""
        return self.mass.value * self.gravity.value - self.guide_lift.value

    @property
    def load_shares(self) -> tuple[Share, ...]:
        """Return what is not known of the load, as effects on the logarithm of all friction.

        Friction is traction over load: a load that is larger makes it smaller.
        """
        gravity, lift, load_n = self.gravity, self.guide_lift, self.normal_force_n
        return (
            Share("gravity", gravity.value, gravity.u, -self.mass.value * gravity.u / load_n),
            Share("guide_lift", lift.value, lift.u, lift.u / load_n),
        )

    @property
    def weight_u(self) -> float:
        """Return the relative standard uncertainty of the load on the wheel."""
        return math.hypot(*(share.effect for share in self.load_shares))

    @property
    def drive_gain(self) -> Known:
        """Return the torque at the wheel for each ampere, N m/A (K_t E G_r of Eq. 51)."""
        return _product(self.torque_constant, self.gear_efficiency, self.gear_ratio)

    @property
    def no_load(self) -> Known:
        """Return the dry torque at the wheel that no current and no bearing gives back, N m."""
        drive = _product(self.no_load_torque, self.gear_efficiency, self.gear_ratio)
        u = math.hypot(drive.u, self.bearing_torque.u)
        return Known(drive.value + self.bearing_torque.value, u)

    @property
    def viscous(self) -> Known:
        """Return the viscous torque at the wheel, N m s."""
        return _product(
            self.no_load_viscous, self.gear_efficiency, self.gear_ratio, self.gear_ratio
        )

    @property
    def inertia(self) -> Known:
        """Return the inertia at the wheel in kg m^2: I_3 + (J_r + J_g) E G_r^2 of Eq. 51."""
        motor = _product(self.motor_inertia, self.gear_efficiency, self.gear_ratio, self.gear_ratio)
        u = math.hypot(motor.u, self.wheel_inertia.u)
        return Known(motor.value + self.wheel_inertia.value, u)


def refuse_lift(lift_n: float, weight_n: float) -> None:
    """Refuse a lift of the guide that is no share of the weight.

    Raises:
        DataError: it is.
    """
    if not abs(lift_n) < weight_n:
        raise _refused(f"guide_lift is {lift_n:g} N, must be below the weight, {weight_n:.4g} N")


def _refused(message: str) -> DataError:
    return DataError(
        message, hint="correct the rig file; for this recording: `--set NAME='VALUE +- U UNIT'`"
    )


def _product(*factors: Known) -> Known:
    """Return the product; of a factor that stands twice, both places move together."""
    moved: dict[Known, float] = {}
    for place, factor in enumerate(factors):
        others = math.prod(other.value for other in (*factors[:place], *factors[place + 1 :]))
        moved[factor] = moved.get(factor, 0.0) + others * factor.u
    return Known(math.prod(factor.value for factor in factors), math.hypot(*moved.values()))
