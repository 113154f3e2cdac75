"""A flywheel as a co-simulation unit of FMI 3, which fails as its parameters ask."""

import os
import signal
import time
from typing import Any

from pythonfmu3 import (
    Boolean,
    Float64,
    Fmi3Causality,
    Fmi3Slave,
    Fmi3Variability,
    Int32,
    String,
    Unit,
)

RPM = 0.10471975511965977


class Flywheel(Fmi3Slave):  # type: ignore[misc] # the library has no types
    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.inertia = 0.05
        self.fault, self.after = "none", 0.0
        self.torque = self.omega = self.number = self.free = 0.0
        self.steps, self.braked, self.temperature = 0, False, 20.0
        self.register_units(
            [
                Unit("kg.m2", kg=1, m=2),
                Unit("N.m", kg=1, m=2, s=-2),
                Unit("rpm", s=-1, rad=1, factor=RPM),
                Unit("degC", K=1, offset=273.15),
                Unit("rad/s", s=-1, rad=1),
                Unit("s", s=1),
            ]
        )
        fixed = {"causality": Fmi3Causality.parameter, "variability": Fmi3Variability.fixed}
        taken = {"causality": Fmi3Causality.input}
        shown = {"causality": Fmi3Causality.output}
        for variable in (
            Float64("time", causality=Fmi3Causality.independent, getter=lambda: 0.0),
            Float64("inertia", unit="kg.m2", **fixed),
            Float64("after", unit="s", **fixed),
            String("fault", **fixed),
            Float64("torque", unit="N.m", **taken),
            Boolean("braked", **taken),
            Float64("free", **taken),
            Float64("speed", unit="rpm", getter=lambda: self.omega / RPM, **shown),
            Float64("omega", unit="rad/s", **shown),
            Float64("temperature", unit="degC", **shown),
            Float64("number", unit="furlong", **shown),
            Int32("steps", **shown),
            String("words", getter=lambda: "none", **shown),
        ):
            self.register_variable(variable)

    def to_xml(self, *options: Any) -> Any:
        root = super().to_xml(*options)
        for name, low, high in (("inertia", "0.001", "10"), ("torque", "-2", "2")):
            variable = root.find(f"ModelVariables/Float64[@name='{name}']")
            variable.set("min", low)
            variable.set("max", high)
        return root

    def exit_initialization_mode(self) -> None:
        if self.fault.startswith("setup-"):
            self.fail(self.fault.removeprefix("setup-"))

    def do_step(self, current_time: float, step_size: float) -> bool:
        if current_time >= self.after and not self.fault.startswith("setup-"):
            if self.fault == "discard":
                return False
            self.fail(self.fault)
        self.omega = 0.0 if self.braked else self.omega + self.torque / self.inertia * step_size
        self.steps += 1
        return True

    def fail(self, fault: str) -> None:
        if fault == "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        elif fault == "exit":
            os._exit(3)
        elif fault == "hang":
            while True:
                pass
        elif fault == "sleep":
            time.sleep(3600)
        elif fault == "error":
            raise RuntimeError("the bearing is gone")
        elif fault == "nan":
            self.temperature = float("nan")
