"""Mistakes in a simulated sled."""

from __future__ import annotations

from sdk.mutants.fresh import Fresh

MUTANTS = (
    Fresh(
        "the encoder counts towards zero",
        "the count at zero is twice as wide: readings are half a count off, to either side",
        (
            (
                "resolution * math.floor((self.state[0] + NOISE_M * noise) / resolution + 0.5)",
                "resolution * int((self.state[0] + NOISE_M * noise) / resolution)",
            ),
        ),
        file="plant",
    ),
    Fresh(
        "the encoder counts in 16 bits",
        "beyond 0.33 m the position jumps by 0.66 m, and a limit of travel acts or does not",
        (
            (
                "        return resolution * math.floor("
                "(self.state[0] + NOISE_M * noise) / resolution + 0.5)\n",
                "        count = math.floor("
                "(self.state[0] + NOISE_M * noise) / resolution + 0.5)\n"
                "        return resolution * ((count + 32768) % 65536 - 32768)\n",
            ),
        ),
        file="plant",
    ),
    Fresh(
        "another surface stops the sled",
        "the energy of the motion is gone, and no friction took it: balances do not close",
        (
            (
                "        self.surface = self.parameters.surfaces[str(value)]\n",
                "        self.surface = self.parameters.surfaces[str(value)]\n"
                "        self.state = (self.state[0], 0.0, *self.state[2:])\n",
            ),
        ),
        file="plant",
    ),
    Fresh(
        "the encoder is read before the plant advances",
        "the position is one cycle old, or not, by the order of the devices in the rig file",
        (
            (
                "        self.link.advance(t_ns)\n"
                "        return EncoderRow.of(position=self.link.encoder())\n",
                "        row = EncoderRow.of(position=self.link.encoder())\n"
                "        self.link.advance(t_ns)\n"
                "        return row\n",
            ),
        ),
        file="devices",
    ),
    Fresh(
        "the energy is that of the shipped mass",
        "with another mass in the file the balance is off, and the plant is blamed for friction",
        (
            (
                "return Energy(0.5 * self.parameters.mass * v * v, supplied, dissipated)",
                "return Energy(0.5 * 2.0 * v * v, supplied, dissipated)",
            ),
        ),
        file="plant",
    ),
    Fresh(
        "seed and step are added",
        "trials of seeds 20 apart have the same noise, a millisecond later: they repeat one"
        " another, and their scatter says nothing",
        (
            (
                "normal_pair(self.seed, self.now_ns - self.origin_ns)",
                "normal_pair(self.seed + self.steps, 0)",
            ),
        ),
        file="plant",
    ),
    Fresh(
        "another surface changes the dry friction alone",
        "steel laid at the bench brakes otherwise than steel in the rig file",
        (
            (
                "        self.surface = self.parameters.surfaces[str(value)]\n",
                "        laid = self.parameters.surfaces[str(value)]\n"
                '        only = {"friction": laid.friction}\n'
                "        self.surface = self.surface.model_copy(update=only)\n",
            ),
        ),
        file="plant",
    ),
)
