"""Declares the filter of slip to rigd: what a rig file gives, and the plan that follows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

from annotated_types import Gt, Le
from pydantic import ValidationInfo, field_validator, model_validator

from rigd.computed.observers.model import (
    Known,
    ObserverModel,
    ObserverOptions,
    ObserverPlan,
    Wanted,
)
from rigd.sdk import Channel, Documented, In, wrong_entry
from rigd_analyses.lugre.trials.known_constants import UNITS


class FrictionOptions(Documented):
    """Parameters of the LuGre law, as `rigd identify` reports them."""

    V_s: Annotated[float, In("m/s"), Gt(0)]
    """Slip at which the Stribeck effect has fallen to 1/e."""
    mu_c: Annotated[float, In("1"), Gt(0)]
    """Normalised Coulomb friction."""
    mu_s: Annotated[float, In("1"), Gt(0)]
    """Normalised static friction; not below `mu_c`."""
    sigma_0: Annotated[float, In("1/m"), Gt(0)]
    """Normalised stiffness of the bristles."""
    sigma_1: Annotated[float, In("s/m"), Gt(0)]
    """Normalised damping of the bristles."""
    sigma_2: Annotated[float, In("s/m"), Gt(0)]
    """Normalised viscous friction."""
    u: Annotated[float, In("1"), Gt(0), Le(1)] = 0.02
    """Relative standard uncertainty of the force at a given slip."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.mu_s < self.mu_c:
            raise wrong_entry(
                f"mu_s is {self.mu_s:g}, must not be below mu_c, {self.mu_c:g}", "mu_s"
            )
        return self


class SlipOptions(ObserverOptions):
    """The keys of a filter of slip in a rig file."""

    wheel_angle: str
    """Encoder of the driven wheel."""
    acceleration: str
    """Accelerometer on the carriage, along the guide."""
    motor_current: str
    """Measured current of the motor."""
    carriage_held: str | None = None
    """Channel, or setpoint as it was written, that is 1 while something else moves the carriage."""
    model_file: Path | None = None
    """What `rigd identify ... --json` wrote: friction, corrections of constants, and noise."""
    group: str | None = None
    """Which group of `model_file`, such as a floor; needed if it has several."""
    friction: FrictionOptions | None = None
    """Parameters of friction, in place of `model_file`."""
    current_noise: Annotated[float, In("A"), Gt(0)] | None = None
    """Standard deviation of `motor_current`; by default that of `model_file`."""
    acceleration_noise: Annotated[float, In("m/s^2"), Gt(0)] | None = None
    """Standard deviation of `acceleration`; by default that of `model_file`."""
    angle_count: Annotated[float, In("rad"), Gt(0)] | None = None
    """Resolution of `wheel_angle`, at the wheel; by default that of `model_file`."""
    unknown_push: Annotated[float, In("m/s^2"), Gt(0)] | None = None
    """Standard deviation of what forces outside of the model do to the carriage; by default from
    the uncertainties of guide and rolling resistance, and 2 cm/s^2 of slope."""
    unknown_torque: Annotated[float, In("A"), Gt(0)] | None = None
    """Standard deviation of torques outside of the model, as a motor current; by default from the
    uncertainty of the no-load torque, and 3 mA of the monitor's zero."""

    @field_validator("model_file")
    @classmethod
    def _beside_rig_file(cls, path: Path | None, info: ValidationInfo) -> Path | None:
        """Resolve the path; ``folder`` in the validation context is the folder of the rig file."""
        folder = (info.context or {}).get("folder") or Path.cwd()
        return None if path is None else (Path(folder) / path).resolve()

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.model_file is None) == (self.friction is None):
            raise wrong_entry(
                "give 'friction', or a 'model_file' that has it; one of them", "friction"
            )
        if self.model_file is None:
            if self.group is not None:
                raise wrong_entry("'group' is of a 'model_file', and there is none", "group")
            for name in ("current_noise", "acceleration_noise", "angle_count"):
                if getattr(self, name) is None:
                    raise wrong_entry(f"key '{name}' is missing: no 'model_file' states it", name)
        return self


class SlipObserver(ObserverModel):
    """Slip of a driven wheel by an extended Kalman filter (lugre.md section 9)."""

    title: ClassVar[str] = "slip of a driven wheel from motor encoder, accelerometer and current"
    Config: ClassVar[type[ObserverOptions]] = SlipOptions
    states: ClassVar[tuple[Channel, ...]] = (
        Channel("slip", "m/s", "slip of the contact: rim speed less carriage speed"),
        Channel("speed", "m/s", "speed of the carriage"),
        Channel("zero", "m/s^2", "zero of the accelerometer"),
    )
    constants: ClassVar[Mapping[str, str]] = UNITS
    optional_constants: ClassVar[frozenset[str]] = frozenset(
        ("no_load_viscous", "bearing_torque", "roller_transitions", "guide_lift")
    )

    @classmethod
    def inputs(cls, options: SlipOptions) -> Sequence[Wanted]:
        """Return the motor current, and what tells that the carriage is held."""
        current = Wanted("motor_current", options.motor_current, "A")
        if options.carriage_held is None:
            return (current,)
        return (current, Wanted("carriage_held", options.carriage_held, "1"))

    @classmethod
    def measured(cls, options: SlipOptions) -> Sequence[Wanted]:
        """Return the encoder of the wheel and the accelerometer."""
        return (
            Wanted("wheel_angle", options.wheel_angle, "rad"),
            Wanted("acceleration", options.acceleration, "m/s^2"),
        )

    @classmethod
    def plan(
        cls, options: SlipOptions, constants: Mapping[str, Known], period_s: float
    ) -> ObserverPlan:
        """Return the filter; raises as :meth:`rigd.computed.observers.model.ObserverModel.plan`."""
        from rigd_analyses.lugre.slip.plan import plan

        return plan(options, constants, period_s)

    @classmethod
    def files(cls, options: SlipOptions) -> Mapping[Path, str]:
        """Return the model file with its text."""
        path: Any = options.model_file
        return {} if path is None else {path: path.read_text(encoding="utf-8")}
