"""Whitens residuals with the noise that is known of input and sensors (Kalman filter).

Noise of the input moves the state, and every later output with it: residuals of a simulated output
drift, and no two samples of them are independent. What a Kalman filter cannot predict of them, its
innovations, is white and of unit variance if the model is right and the noise is as stated
(Kailath, IEEE Trans. Automatic Control 13, 1968). The filter is linear, so that derivatives of the
residuals go through it as the residuals do.

For small deviations dy of the state from a simulated motion, with white noise e of the input
(variance 1, held for a sample) and independent noise of each reading (variance r):

    dy[k + 1] = F[k] dy[k] + G[k] e[k],    output[k] = C[k] dy[k] + reading noise

Outputs are processed one after the other (Anderson and Moore, Optimal Filtering, 1979, sec. 6.4).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rigd.analysis.kernel import kernel
from rigd.analysis.result import BoolArray, FloatArray

WIDTH = 8  #: rows of compiled loops are padded to a multiple of it


@dataclass(frozen=True, eq=False)
class Deviations:
    """How noise moves one trial: ``forward`` F (n, s, s), ``driven`` G (n, s), ``seen`` (n, m, s).

    ``variance`` (n, m) is that of the readings in the outputs' units squared, infinite if there is
    no reading; ``first`` (s,) is that of the state at the first sample. A value that is unknown but
    constant is a state that stays. ``mix`` (m, m) makes of the outputs the readings that ``seen``
    and ``variance`` are of, whose noise is independent. ``counts`` (m,) are the steps in which
    these are shown, 0 of one that is not counted; none may be given.
    """

    forward: FloatArray
    driven: FloatArray
    seen: FloatArray
    variance: FloatArray
    first: FloatArray
    mix: FloatArray
    counts: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Whitener:
    """The filter of one trial: ``gain`` (n, m, s) of each reading, ``scale`` (n, m) 1/sd of it."""

    deviations: Deviations
    gain: FloatArray
    scale: FloatArray

    @staticmethod
    def of(deviations: Deviations) -> Whitener:
        """Return the filter of one trial."""
        gain, scale = _gains(
            deviations.forward, deviations.driven, deviations.seen, deviations.variance,
            deviations.first,
        )  # fmt: skip
        return Whitener(deviations, gain, scale)

    @property
    def log_scale(self) -> float:
        """Return the sum of the logarithms of ``scale``: ln L of readings without an error."""
        return float(np.sum(np.log(self.scale[self.there])))

    @property
    def there(self) -> BoolArray:
        """Return whether there is a reading, (n, m)."""
        return np.asarray(self.scale > 0.0)

    def whiten(self, columns: FloatArray) -> FloatArray:
        """Return the innovations (n, m, c) of ``columns`` (n, m, c), in standard deviations."""
        at = self.deviations
        return _innovations(
            np.ascontiguousarray(columns), at.mix, at.forward, at.seen, self.gain, self.scale
        )

    def whiten_errors(self, errors: FloatArray) -> FloatArray:
        """Return the innovations (n, m) of ``errors`` (n, m), in standard deviations."""
        at = self.deviations
        return _innovations_of_one(errors, at.mix, at.forward, at.seen, self.gain, self.scale)

    def counted(self, measured: FloatArray, white: FloatArray) -> FloatArray:
        """Return the errors (n, m) of counting, in standard deviations as ``white`` (n, m) is.

        They are those of the motion that the filter predicts before each reading, ``measured``
        (n, m). At a steady speed they make tones, where the noise of rounding is taken as white.
        """
        at = self.deviations
        found = np.zeros(white.shape)
        for place, count in enumerate(at.counts):
            if count > 0.0:
                scale = np.maximum(self.scale[:, place], np.finfo(np.float64).tiny)
                motion = (measured @ at.mix[place] + white[:, place] / scale) / count
                found[:, place] = (np.rint(motion) - motion) * count * self.scale[:, place]
        return found

    def normal_equations(
        self, errors: FloatArray, jacobian: FloatArray, weights: FloatArray
    ) -> tuple[float, FloatArray, FloatArray]:
        """Return cost, gradient (p,) and information (p, p), without keeping what is whitened.

        ``errors`` (n, m) and ``jacobian`` (n, m, p) are not whitened; ``weights`` (n, m) are those
        of the innovations.
        """
        at = self.deviations
        return _normal_equations(
            errors, jacobian, weights, at.mix, at.forward, at.seen, self.gain, self.scale
        )


@kernel
def spread(
    forward: FloatArray, driven: FloatArray, n: int, p: FloatArray, moved: FloatArray
) -> None:
    """Take the covariance ``p`` (s, s) of the state from sample ``n`` to the next, in place.

    ``moved`` (s, s) is room for it.
    """
    states = p.shape[0]
    for a in range(states):
        for b in range(states):
            total = 0.0
            for c in range(states):
                total += forward[n, a, c] * p[c, b]
            moved[a, b] = total
    for a in range(states):
        for b in range(states):
            total = driven[n, a] * driven[n, b]
            for c in range(states):
                total += moved[a, c] * forward[n, b, c]
            p[a, b] = total


@kernel
def _gains(
    forward: FloatArray, driven: FloatArray, seen: FloatArray, variance: FloatArray,
    first: FloatArray,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    count, outputs, states = seen.shape
    gain, scale = np.zeros((count, outputs, states)), np.zeros((count, outputs))
    p = np.diag(first)
    moved = np.zeros((states, states))
    pc = np.zeros(states)
    for n in range(count):
        for m in range(outputs):
            s = variance[n, m]
            for a in range(states):
                pc[a] = 0.0
                for b in range(states):
                    pc[a] += p[a, b] * seen[n, m, b]
            for a in range(states):
                s += seen[n, m, a] * pc[a]
            scale[n, m] = 1.0 / np.sqrt(s)
            for a in range(states):
                gain[n, m, a] = pc[a] / s
            for a in range(states):
                for b in range(states):
                    p[a, b] -= pc[a] * pc[b] / s
        spread(forward, driven, n, p, moved)
    return gain, scale


@kernel
def _innovate(
    columns: FloatArray, n: int, mix: FloatArray, seen: FloatArray, gain: FloatArray,
    y: FloatArray, rows: FloatArray,
) -> None:  # fmt: skip
    """Write the innovations of sample ``n`` to ``rows`` (m, c) and correct the state ``y`` (s, c).

    ``columns`` (m, c) are the outputs of this sample.
    """
    outputs, width = rows.shape
    for m in range(outputs):
        row = rows[m]
        row[:] = 0.0
        for j in range(outputs):
            share, column = mix[m, j], columns[j]
            if share != 0.0:
                for k in range(width):
                    row[k] += share * column[k]
        for a in range(y.shape[0]):
            share, state = seen[n, m, a], y[a]
            if share != 0.0:
                for k in range(width):
                    row[k] -= share * state[k]
        for a in range(y.shape[0]):
            share, state = gain[n, m, a], y[a]
            for k in range(width):
                state[k] += share * row[k]


@kernel
def _move(forward: FloatArray, n: int, y: FloatArray, new: FloatArray) -> None:
    """Write the state behind the step from sample ``n`` to ``new`` (s, c)."""
    for a in range(y.shape[0]):
        after = new[a]
        after[:] = 0.0
        for b in range(y.shape[0]):
            share, before = forward[n, a, b], y[b]
            if share != 0.0:
                for k in range(after.size):
                    after[k] += share * before[k]


@kernel
def _innovations(
    columns: FloatArray, mix: FloatArray, forward: FloatArray, seen: FloatArray, gain: FloatArray,
    scale: FloatArray,
) -> FloatArray:  # fmt: skip
    count, outputs, width = columns.shape
    out = np.zeros((count, outputs, width))
    y, new = np.zeros((seen.shape[2], width)), np.zeros((seen.shape[2], width))
    for n in range(count):
        _innovate(columns[n], n, mix, seen, gain, y, out[n])
        for m in range(outputs):
            out[n, m] *= scale[n, m]
        _move(forward, n, y, new)
        y, new = new, y
    return out


@kernel
def _innovations_of_one(
    errors: FloatArray, mix: FloatArray, forward: FloatArray, seen: FloatArray, gain: FloatArray,
    scale: FloatArray,
) -> FloatArray:  # fmt: skip
    """Return the innovations (n, m) of a single column: the same bits, in a fifth of the time."""
    count, outputs = errors.shape
    states = seen.shape[2]
    out = np.zeros((count, outputs))
    y, new = np.zeros(states), np.zeros(states)
    for n in range(count):
        for m in range(outputs):
            row = 0.0
            for j in range(outputs):
                row += mix[m, j] * errors[n, j]
            for a in range(states):
                row -= seen[n, m, a] * y[a]
            for a in range(states):
                y[a] += gain[n, m, a] * row
            out[n, m] = row * scale[n, m]
        for a in range(states):
            total = 0.0
            for b in range(states):
                total += forward[n, a, b] * y[b]
            new[a] = total
        y, new = new, y
    return out


@kernel
def _add_products(four: FloatArray, products: FloatArray) -> None:
    """Add the products of the columns of ``four`` (4, c): four rows at once save memory traffic."""
    a, b, c, d = four[0], four[1], four[2], four[3]
    for i in range(products.shape[0]):
        p, q, r, s, into = a[i], b[i], c[i], d[i], products[i]
        for k in range(into.size):
            into[k] += (p * a[k] + q * b[k]) + (r * c[k] + s * d[k])


@kernel
def _normal_equations(
    errors: FloatArray, jacobian: FloatArray, weights: FloatArray, mix: FloatArray,
    forward: FloatArray, seen: FloatArray, gain: FloatArray, scale: FloatArray,
) -> tuple[float, FloatArray, FloatArray]:  # fmt: skip
    count, outputs, width = jacobian.shape
    # The errors are one more column; no loop of the processor has a rest.
    padded = (width + 1 + WIDTH - 1) // WIDTH * WIDTH
    products = np.zeros((width + 1, padded))
    columns, rows = np.zeros((outputs, padded)), np.zeros((outputs, padded))
    four, filled = np.zeros((4, padded)), 0
    y, new = np.zeros((seen.shape[2], padded)), np.zeros((seen.shape[2], padded))
    for n in range(count):
        for m in range(outputs):
            for k in range(width):
                columns[m, k] = jacobian[n, m, k]
            columns[m, width] = errors[n, m]
        _innovate(columns, n, mix, seen, gain, y, rows)
        for m in range(outputs):
            share, row, into = np.sqrt(weights[n, m]) * scale[n, m], rows[m], four[filled]
            for k in range(padded):
                into[k] = share * row[k]
            filled += 1
            if filled == 4:
                _add_products(four, products)
                filled = 0
        _move(forward, n, y, new)
        y, new = new, y
    four[filled:] = 0.0
    _add_products(four, products)
    cost = 0.5 * float(products[width, width])
    return cost, products[width, :width].copy(), products[:width, :width].copy()
