"""A quarter of a trailer as a co-simulation unit of FMI 3; build_fmus makes the FMU of it.

A mass that the wheel of a rig draws along: its input is the force that the rig measures at the
wheel, its output the speed at which the rig must then move. It needs nothing but PythonFMU3.
"""

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability, Unit


class Trailer(Fmi3Slave):
    """The mass, with rolling resistance, which holds it while it stands."""

    description = "A quarter of a trailer, drawn by a wheel"
    author = "rigd"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.mass, self.drag, self.rolling = 20.0, 1.0, 0.5
        self.force = self.speed = self.distance = 0.0
        self.register_units(
            [
                Unit("m", m=1),
                Unit("m/s", m=1, s=-1),
                Unit("N", kg=1, m=1, s=-2),
                Unit("kg", kg=1),
                Unit("N.s/m", kg=1, s=-1),
            ]
        )
        fixed = {"causality": Fmi3Causality.parameter, "variability": Fmi3Variability.fixed}
        self.register_variable(
            Float64("time", causality=Fmi3Causality.independent, getter=lambda: 0.0)
        )
        self.register_variable(Float64("mass", unit="kg", **fixed))
        self.register_variable(Float64("drag", unit="N.s/m", **fixed))
        self.register_variable(Float64("rolling", unit="N", **fixed))
        self.register_variable(Float64("force", unit="N", causality=Fmi3Causality.input))
        self.register_variable(Float64("speed", unit="m/s", causality=Fmi3Causality.output))
        self.register_variable(Float64("distance", unit="m", causality=Fmi3Causality.output))

    def do_step(self, current_time, step_size):
        """Move by one step of semi-implicit Euler; rolling resistance never turns the motion."""
        free = self.speed + (self.force - self.drag * self.speed) / self.mass * step_size
        held = self.rolling / self.mass * step_size
        self.speed = max(abs(free) - held, 0.0) * (1.0 if free > 0 else -1.0)
        self.distance += self.speed * step_size
        return True
