"""Reads encoder counts from a counter of a card.

The module corrects overflows of the counter, and refuses jumps that cannot be motion.
"""

from __future__ import annotations

from time import monotonic_ns
from typing import Final

from rigd.sdk import DeviceError
from rigd_drivers.cards.card import Card

#: A standing encoder may show one count to and fro, however short the time.
_LEAST_STEP: Final = 1.0


class EncoderCounter:
    """Counts of one encoder since it was opened.

    Args:
        encoder: the encoder input of the card.
        fastest: count rate that the rig cannot reach, in count/s.

    """

    def __init__(self, encoder: int, fastest: float) -> None:
        self.encoder = encoder
        self.counts = 0
        self._per_ns = fastest * 1e-9
        self._raw = 0
        self._since_ns = 0

    def open(self, card: Card, *, at_zero: bool) -> None:
        """Begin at zero, or at what the counter shows as a signed number."""
        card.use_inputs(encoders=(self.encoder,))
        card.sample()
        self._half = 1 << (card.count_bits - 1)
        self._mask = (1 << card.count_bits) - 1
        self._raw = card.counts[self.encoder]
        self._since_ns = card.sampled_ns
        self.counts = 0 if at_zero else self._signed(self._raw)

    def take(self, card: Card) -> int:
        """Return the counts as the card has taken them in.

        Raises:
            DeviceError: they jumped further than the rig can move.

        """
        raw = card.counts[self.encoder]
        step = self._signed(raw - self._raw)
        if step:
            # From before the last sample to after this one: a stall between never looks like one.
            elapsed_ns = monotonic_ns() - self._since_ns
            if abs(step) > max(self._per_ns * elapsed_ns, _LEAST_STEP):
                raise self._jumped(step, elapsed_ns)
            self._raw = raw
            self.counts += step
        self._since_ns = card.sampled_ns
        return self.counts

    def _signed(self, difference: int) -> int:
        return ((difference + self._half) & self._mask) - self._half

    def _jumped(self, step: int, elapsed_ns: int) -> DeviceError:
        return DeviceError(
            f"encoder {self.encoder} jumped by {step} counts in {elapsed_ns * 1e-6:.3g} ms; "
            f"at most {self._per_ns * 1e9:g} count/s are motion",
            hint="its counter was reset or its signal broke off: check cable and supply, and bring "
            "the rig to its zero before the next run; if it can be so fast, raise 'fastest'",
        )
