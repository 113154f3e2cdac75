"""The LuGre omni-wheel rig as a co-simulation unit of FMI 2; build_fmus makes the FMU of it.

Inputs are those of the simulated amplifier and of the longitudinal belt, outputs the hidden state.
rigd must be installed where the FMU runs. PythonFMU writes no units: the rig file gives them.
"""

from copy import copy
from xml.etree.ElementTree import SubElement

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real, String

from rigd_sim.lugre import layout
from rigd_sim.lugre.plant import LugreConfig, LugrePlant


class LugreRig(Fmi2Slave):
    """The plant, with the inputs and outputs above."""

    description = "One quarter of a mobile robot on a linear guide, driven by its omni-wheel"
    author = "rigd"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.mass = 3.9593
        self.floor = "stone"
        self.current = self.enabled = self.belt_speed = 0.0
        self.belt_engaged = 1.0
        self.plant = None
        self.t_ns = 0
        parameter = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}
        self.register_variable(Real("mass", description="of the quarter model, in kg", **parameter))
        self.register_variable(String("floor", description="stone, pvc or paperboard", **parameter))
        for name in ("current", "enabled", "belt_speed", "belt_engaged"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for index, (name, unit, doc) in enumerate(layout.TRUTH):
            self.register_variable(
                Real(
                    name,
                    causality=Fmi2Causality.output,
                    description=f"{doc}, in {unit}",
                    getter=lambda index=index: self.truth(index),
                )
            )

    def to_xml(self, model_options=None):
        """Return the model description, with the initial unknowns that PythonFMU leaves out."""
        root = super().to_xml(model_options or {})
        structure = root.find("ModelStructure")
        unknowns = SubElement(structure, "InitialUnknowns")
        unknowns.extend(copy(item) for item in structure.findall("Outputs/Unknown"))
        return root

    def exit_initialization_mode(self):
        """Make the plant of the parameters."""
        options = {
            "parameters": str(LugreConfig.shipped_folder / "lugre.yaml"),
            "floor": self.floor,
            "mass": f"{self.mass!r} kg",
            "noise": False,
        }
        config = LugreConfig.model_validate(options)
        self.plant = LugrePlant(config, period_ns=1_000_000, seed=1)
        self.plant.advance(0)

    def truth(self, index):
        """Return an output; 0 before there is a plant."""
        return 0.0 if self.plant is None else self.plant.readings[layout.TRUTH_READINGS + index]

    def do_step(self, current_time, step_size):
        """Give the plant its inputs, and advance it."""
        self.plant.commands[layout.WHEEL_CURRENT] = self.current
        self.plant.commands[layout.WHEEL_ENABLED] = float(self.enabled >= 0.5)
        self.plant.commands[layout.BELT_COMMANDS] = self.belt_speed
        self.plant.commands[layout.BELT_COMMANDS + 1] = float(self.belt_engaged >= 0.5)
        self.plant.advance(round((current_time + step_size) * 1e9))
        return True
