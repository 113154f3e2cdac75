"""The articulated robot as a co-simulation unit of FMI 3; build_fmus makes the FMU of it.

Inputs are the speeds of the two motors of the front module, outputs its pose and its speeds.
rigd must be installed where the FMU runs.
"""

from pythonfmu3 import Float64, Fmi3Causality, Fmi3Slave, Fmi3Variability, String, Unit

from rigd_sim.articulated.plant import ArticulatedConfig, ArticulatedPlant

#: Outputs: the first of the plant's hidden state of a module, in its order.
OUTPUTS = (
    ("x", "m"),
    ("y", "m"),
    ("heading", "rad"),
    ("forward_speed", "m/s"),
    ("lateral_speed", "m/s"),
    ("yaw_rate", "rad/s"),
)
MOTORS = {"right": "front_right", "left": "rear_left"}


class ArticulatedRobot(Fmi3Slave):
    """The plant, with the inputs and outputs above."""

    description = "A robot of two modules with mecanum wheels"
    author = "rigd"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.law = "smooth"
        self.right_speed = self.left_speed = self.enabled = 0.0
        self.plant = None
        self.register_units(
            [
                Unit("m", m=1),
                Unit("rad", rad=1),
                Unit("m/s", m=1, s=-1),
                Unit("rad/s", rad=1, s=-1),
                Unit("rpm", rad=1, s=-1, factor=0.10471975511965977),
            ]
        )
        self.register_variable(
            Float64("time", causality=Fmi3Causality.independent, getter=lambda: 0.0)
        )
        self.register_variable(
            String(
                "law",
                causality=Fmi3Causality.parameter,
                variability=Fmi3Variability.fixed,
                description="contact law: paper, smooth or linear",
            )
        )
        for name in ("right_speed", "left_speed"):
            self.register_variable(Float64(name, causality=Fmi3Causality.input, unit="rpm"))
        self.register_variable(Float64("enabled", causality=Fmi3Causality.input))
        for index, (name, unit) in enumerate(OUTPUTS):
            self.register_variable(
                Float64(
                    name,
                    causality=Fmi3Causality.output,
                    unit=unit,
                    getter=lambda index=index: self.truth(index),
                )
            )

    def exit_initialization_mode(self):
        """Make the plant of the parameters."""
        options = {
            "parameters": str(ArticulatedConfig.shipped_folder / "articulated.yaml"),
            "law": self.law,
            "noise": False,
        }
        config = ArticulatedConfig.model_validate(options)
        self.plant = ArticulatedPlant(config, period_ns=1_000_000, seed=1)
        self.plant.advance(0)

    def truth(self, index):
        """Return an output; 0 before there is a plant."""
        return 0.0 if self.plant is None else float(self.plant.truth(0)[index])

    def do_step(self, current_time, step_size):
        """Give the plant its inputs, and advance it."""
        for name, wheel in MOTORS.items():
            spin = self.plant.spin_of("front", wheel)
            speed = getattr(self, f"{name}_speed") * 0.10471975511965977
            self.plant.commands[spin] = speed, float(self.enabled >= 0.5)
        self.plant.advance(round((current_time + step_size) * 1e9))
        return True
