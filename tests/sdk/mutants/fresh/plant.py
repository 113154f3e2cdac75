"""Mistakes in the physics of a sled and in its simulated devices."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_NOISE = "        noise, _ = normal_pair(self.seed, self.now_ns - self.origin_ns)\n"
_FORCE = "        self.force = 0.0\n        self.state"
_STEP = "    def step(self, step_s: float) -> None:\n"

MUTANTS = (
    Fresh(
        "noise is drawn from the seed of the construction",
        "every trial has the same noise: repetitions show no scatter",
        (
            (_FORCE, "        self._first_seed = seed\n" + _FORCE),
            (_NOISE, _NOISE.replace("self.seed", "self._first_seed")),
        ),
        "plant",
    ),
    Fresh(
        "noise comes from a generator with a state",
        "a device that reads twice changes what all others measure afterwards",
        (
            ("import math\n", "import math\nimport random\n"),
            (_FORCE, "        self._random = random.Random(seed)\n" + _FORCE),
            (_NOISE, "        noise = self._random.gauss(0.0, 1.0)\n"),
        ),
        "plant",
    ),
    Fresh(
        "noise is remembered for all plants",
        "a second plant in the process has the noise of the first, whatever its seed",
        (
            ("#: Noise of the encoder", "_DRAWN: dict[int, float] = {}\n#: Noise of the encoder"),
            (
                _NOISE,
                "        at_ns = self.now_ns - self.origin_ns\n"
                "        if at_ns not in _DRAWN:\n"
                "            _DRAWN[at_ns] = normal_pair(self.seed, at_ns)[0]\n"
                "        noise = _DRAWN[at_ns]\n",
            ),
        ),
        "plant",
    ),
    Fresh(
        "the option for noise is ignored",
        "a rig file that asks for an encoder without noise gets noise",
        (
            (
                "        if not self.config.noise:\n            return self.state[0]\n",
                "",
            ),
        ),
        "plant",
    ),
    Fresh(
        "the motor follows by half with each write",
        "the same procedure moves the sled in another way at another cycle time",
        (
            (
                "            self.link.force = min(max(force, -largest), largest)\n",
                "            wanted = min(max(force, -largest), largest)\n"
                "            self.link.force += 0.5 * (wanted - self.link.force)\n",
            ),
        ),
        "devices",
    ),
    Fresh(
        "dry friction is that of the surface at the start",
        "a person lays steel: the sled slides as on oak",
        (
            (_FORCE, "        self._dry = self.surface.friction\n" + _FORCE),
            (
                "        dry = self.surface.friction * p.mass",
                "        dry = self._dry * p.mass",
            ),
        ),
        "plant",
    ),
    Fresh(
        "each call is divided into 20 steps",
        "the motion depends on the cycle time of the rig and on how often devices read",
        (
            (
                _STEP,
                "    def evolve(self, t_ns: int, elapsed_ns: int) -> None:\n"
                "        for _ in range(20):\n"
                "            self.step(elapsed_ns * 1e-9 / 20)\n\n" + _STEP,
            ),
        ),
        "plant",
    ),
    Fresh(
        "supplied energy never falls",
        "while the motor brakes the plant gets energy from it: the balance is wrong",
        (("/ p.mass, self.force * v, drag * v", "/ p.mass, abs(self.force * v), drag * v"),),
        "plant",
    ),
    Fresh(
        "the encoder relies on the motor to advance the plant",
        "listed before the motor, the encoder gives the position of the cycle before",
        (
            (
                "        self.link.advance(t_ns)\n        return EncoderRow",
                "        return EncoderRow",
            ),
        ),
        "devices",
    ),
)
