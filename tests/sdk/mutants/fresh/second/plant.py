"""Mistakes in the physics of a sled and its simulated devices."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

_SURFACE = "        self.surface = self.parameters.surfaces[str(value)]\n"

MUTANTS = (
    Fresh(
        "another surface sets the sled back",
        "the operator lays steel under the sled, and it stands at 0 again",
        ((_SURFACE, _SURFACE + "        self.state = (0.0, 0.0, 0.0, 0.0)\n"),),
        "plant",
    ),
    Fresh(
        "another surface changes dry friction only",
        "after oak, steel has the viscous friction of oak: its identified c is 1.5, not 0.8 N s/m",
        (
            (
                _SURFACE,
                "        friction = self.parameters.surfaces[str(value)].friction\n"
                '        self.surface = self.surface.model_copy(update={"friction": friction})\n',
            ),
        ),
        "plant",
    ),
    Fresh(
        "counts are rounded towards zero",
        "below 0 the encoder shows one count too much, and it stands still for two counts at 0",
        (
            (
                "math.floor((self.state[0] + NOISE_M * noise) / resolution + 0.5)",
                "int((self.state[0] + NOISE_M * noise) / resolution + 0.5)",
            ),
        ),
        "plant",
    ),
    Fresh(
        "the noise follows the clock, not the run",
        "the same seed gives other noise in every run: no run can be repeated",
        (("self.now_ns - self.origin_ns)", "self.now_ns)"),),
        "plant",
    ),
    Fresh(
        "the motor is as strong as its option says",
        "with force_range 50 N the motor of 20 N pushes with 50 N",
        (
            (
                "            largest = self.link.parameters.largest_force\n",
                "            largest = self.config.force_range\n",
            ),
        ),
        "devices",
    ),
    Fresh(
        "the encoder does not advance the plant",
        "as first device of a rig the encoder shows the position one cycle ago",
        (
            (
                "        self.link.advance(t_ns)\n        return EncoderRow.of(",
                "        return EncoderRow.of(",
            ),
        ),
        "devices",
    ),
    Fresh(
        "viscous friction has the same sign in both directions",
        "a sled that moves in reverse is driven by its viscous friction",
        (("self.surface.viscous * v\n", "self.surface.viscous * abs(v)\n"),),
        "plant",
    ),
)
