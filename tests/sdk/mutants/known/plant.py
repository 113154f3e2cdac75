"""Mistakes in the plant that `rigd new plant` writes."""

from __future__ import annotations

from sdk.mutants.known import Mutant

_RATES = "        return v, (self.force - drag) / p.mass, self.force * v, drag * v\n"
_STEP = "        self.state = _along(self.state, self.rates(middle), step_s)\n"
_START = "        self.state: State = (0.0, 0.0, 0.0, 0.0)\n"
_NOISE = "normal_pair(self.seed, self.now_ns - self.origin_ns)"
_DEF_RATES = "    def rates(self, state: State) -> State:\n"
_ENCODER = "        noise, _ = " + _NOISE + "\n"


def _rates(speeding: str, supplied: str = "self.force * v", dissipated: str = "drag * v") -> str:
    return f"        return v, {speeding} / p.mass, {supplied}, {dissipated}\n"


_RIGHT = "(self.force - drag)"

MUTANTS = (
    # energy
    Mutant(
        "wind from nowhere", "energy balances", _RATES, _rates("(self.force - drag + 1.0)"), "plant"
    ),
    Mutant(
        "half the friction lost",
        "energy balances",
        _RATES,
        _rates("(self.force - 0.5 * drag)"),
        "plant",
    ),
    Mutant("supply not counted", "energy balances", _RATES, _rates(_RIGHT, "0.0"), "plant"),
    Mutant(
        "supply inverted", "energy balances", _RATES, _rates(_RIGHT, "-self.force * v"), "plant"
    ),
    Mutant(
        "dissipation not counted",
        "energy balances",
        _RATES,
        _rates(_RIGHT, dissipated="0.0"),
        "plant",
    ),
    Mutant(
        "twice the kinetic energy",
        "energy balances",
        "0.5 * self.parameters.mass * v * v",
        "self.parameters.mass * v * v",
        "plant",
    ),
    Mutant(
        "mass left out", "energy balances", _RATES, _rates(_RIGHT).replace(" / p.mass", ""), "plant"
    ),
    Mutant(
        "speed leaks",
        "energy balances",
        _STEP,
        _STEP + "        x, v, *rest = self.state\n        self.state = (x, 0.9999 * v, *rest)\n",
        "plant",
    ),
    Mutant(
        "friction drives",
        "friction takes",
        "self.surface.friction * p.mass",
        "-0.1 * self.surface.friction * p.mass",
        "plant",
    ),
    # the integrator
    Mutant(
        "Euler for midpoint",
        "halved step",
        "self.rates(middle), step_s)",
        "self.rates(self.state), step_s)",
        "plant",
    ),
    Mutant(
        "step too long",
        "halved step",
        "step_ns: ClassVar[int] = 50_000",
        "step_ns: ClassVar[int] = 5_000_000",
        "plant",
    ),
    Mutant(
        "order overstated",
        "halved step",
        "order: ClassVar[int] = 2",
        "order: ClassVar[int] = 4",
        "plant",
    ),
    # repeatability, seed, time
    Mutant(
        "unseeded noise",
        "any sequence",
        _NOISE,
        "(__import__('random').gauss(0.0, 1.0), 0.0)",
        "plant",
    ),
    Mutant(
        "state of another plant",
        "any sequence",
        _START,
        "        type(self)._left = getattr(type(self), '_left', 0.0) + 0.1\n"
        "        self.state: State = (type(self)._left, 0.0, 0.0, 0.0)\n",
        "plant",
    ),
    Mutant("seed ignored", "any sequence", "normal_pair(self.seed, ", "normal_pair(1, ", "plant"),
    Mutant(
        "noise of absolute time",
        "any sequence",
        "self.now_ns - self.origin_ns",
        "self.now_ns",
        "plant",
    ),
    Mutant(
        "noise of each look",
        "any sequence",
        _ENCODER,
        "        self._looks = getattr(self, '_looks', 0) + 1\n"
        "        noise, _ = normal_pair(self.seed, self._looks)\n",
        "plant",
    ),
    Mutant(
        "goes back in time",
        "any sequence",
        _DEF_RATES,
        "    def advance(self, t_ns: int) -> None:\n        if t_ns > getattr(self, '_at', -1):\n"
        "            self._at = t_ns\n            super().advance(t_ns)\n\n" + _DEF_RATES,
        "plant",
    ),
    Mutant(
        "creeps with each call",
        "any sequence",
        _DEF_RATES,
        "    def advance(self, t_ns: int) -> None:\n        super().advance(t_ns)\n"
        "        x, *rest = self.state\n        self.state = (x + 1e-4, *rest)\n\n" + _DEF_RATES,
        "plant",
    ),
    # values
    Mutant(
        "NaN at the far end",
        "finite",
        _ENCODER,
        "        if abs(self.state[1]) > 0.02:\n            return math.nan\n" + _ENCODER,
        "plant",
    ),
    Mutant(
        "encoder in mm",
        "units agree",
        "position=self.link.encoder()",
        "position=1e3 * self.link.encoder()",
        "devices",
    ),
    Mutant(
        "encoder inverted",
        "units agree",
        "position=self.link.encoder()",
        "position=-self.link.encoder()",
        "devices",
    ),
    Mutant(
        "force shown in kN",
        "units agree",
        "MotorRow.of(force=self.link.force)",
        "MotorRow.of(force=1e-3 * self.link.force)",
        "devices",
    ),
    Mutant(
        "force inverted",
        "units agree",
        "self.link.force = min(max(force, -largest), largest)",
        "self.link.force = -min(max(force, -largest), largest)",
        "devices",
    ),
    # devices that are made safe
    Mutant(
        "safe goes on pushing",
        "passive",
        "        self._armed = False\n        self.link.force = 0.0\n",
        "        self._armed = False\n",
        "devices",
    ),
    # declarations
    Mutant("no title", "title", '"sled on a surface, pushed by a motor"', '""', "plant"),
    Mutant(
        "option without docs",
        "options",
        '    """Whether the encoder has noise and a finite resolution."""\n',
        "",
        "plant",
    ),
    Mutant(
        "mass without bounds",
        "parameters",
        'In("kg"), Ge(0.1), Le(100)]',
        'In("kg")]',
        "parameters",
    ),
    Mutant(
        "parameter without docs", "parameters", '    """Mass of the sled."""\n', "", "parameters"
    ),
    Mutant(
        "setting without docs",
        "settings",
        '"the surface under the sled", surfaces',
        '"", surfaces',
        "plant",
    ),
    Mutant(
        "setting not refused",
        "settings",
        "    def apply(self, quantity",
        "    def change(self, quantity: str, value: float | str) -> None:\n        pass\n\n"
        "    def apply(self, quantity",
        "plant",
    ),
    Mutant(
        "surface of another file",
        "constructor",
        "surfaces[config.surface]\n        #",
        "surfaces['ice']\n        #",
        "plant",
    ),
    # what only other parameters, seeds and ways show
    Mutant(
        "energy of another mass",
        "energy balances",
        "0.5 * self.parameters.mass * v * v",
        "1.0 * v * v",
        "plant",
    ),
    Mutant(
        "seed plus time",
        "any sequence",
        "normal_pair(self.seed, self.now_ns - self.origin_ns)",
        "normal_pair(self.seed + (self.now_ns - self.origin_ns) // 1_000_000, 0)",
        "plant",
    ),
    Mutant(
        "counter of 15 bits",
        "units agree",
        "math.floor((self.state[0] + NOISE_M * noise) / resolution + 0.5)",
        "(math.floor((self.state[0] + NOISE_M * noise) / resolution + 0.5) % 32768)",
        "plant",
    ),
    Mutant(
        "surface that pushes",
        "settings move nothing",
        "        self.surface = self.parameters.surfaces[str(value)]\n",
        "        self.surface = self.parameters.surfaces[str(value)]\n"
        "        self.state = (self.state[0], self.state[1] + 0.1, *self.state[2:])\n",
        "plant",
    ),
)
