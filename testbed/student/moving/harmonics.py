"""The rhythm of a motion: its period and a few harmonics, so that it can be played on for ever. An extension.

The paper feeds the controller the roll history as it was recorded (Section 3.4.1). A history of a few seconds at the
camera's rate is noisy, coarse beside the control rate, and ends; interpolating key poses loses the gait. A gait,
though, repeats itself: all rolls share one period, and a few sines each are the motion. What does not repeat itself
is smoothed and played once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.parameters import HarmonicsParameters

_TURN = 2 * math.pi


@dataclass(frozen=True)
class Harmonics:
    """A motion of k channels that can be asked for at any time.

    Attributes:
        period: Of all channels, s; None if the motion has no rhythm.
        start: Time at which the phases are zero, s; the first time seen.
        coefficients: (1 + 2 h, k) rad: the centre, then cosine and sine of every harmonic. Without a rhythm (F, k):
            the smoothed motion at ``knots``.
        knots: (F,) the times seen, s.
        explained: Share of the variance that the harmonics explain.
        noise: Robust standard deviation of what they leave, rad.
    """

    period: float | None
    start: float
    coefficients: Vector
    knots: Vector
    explained: float
    noise: float

    @property
    def order(self) -> int:
        """How many harmonics."""
        return 0 if self.period is None else (len(self.coefficients) - 1) // 2

    def read(self, sign: float, offset: Vector) -> Harmonics:
        """The same rhythm of ``sign`` x channel + ``offset`` (k,), rad."""
        coefficients = sign * self.coefficients
        centre = coefficients if self.period is None else coefficients[:1]
        centre += offset
        return replace(self, coefficients=coefficients)

    def at(self, times: Vector) -> Vector:
        """The motion (n, k), rad, at times (n,), s. Without a rhythm it stays at its ends before and after."""
        if self.period is None:
            return np.stack(
                [np.interp(times, self.knots, channel) for channel in self.coefficients.T], axis=1
            )
        return np.asarray(design(times - self.start, self.period, self.order) @ self.coefficients)


def design(times: Vector, period: float, order: int) -> Vector:
    """(n, 1 + 2 order): one, cosines and sines of the harmonics of a period (s) at times (n,)."""
    phases = np.outer(times, _TURN / period * np.arange(1, order + 1))
    waves = np.ones((len(phases), 1 + 2 * order))
    waves[:, 1::2], waves[:, 2::2] = np.cos(phases), np.sin(phases)
    return waves


def unwrapped(rolls: Vector) -> Vector:
    """Rolls (F, k) made continuous in time, modulo half a turn, the first frame as it is.

    Parts look the same after half a turn, and nobody turns by a quarter between two frames: a jump is a change of
    mind of whoever looked, not a motion.
    """
    return np.asarray(np.unwrap(rolls, axis=0, period=math.pi))


def fit_harmonics(times: Vector, rolls: Vector, parameters: HarmonicsParameters | None = None) -> Harmonics:
    """The rhythm of a motion.

    The period and the number of harmonics are those with the smallest information criterion: every period on a
    grid is tried with every number of harmonics (the rest is linear), the best are refined, frames far off count
    less, and a multiple of the period or a further harmonic must earn its terms.

    Args:
        times: (F,) s, rising, not necessarily regular.
        rolls: (F, k) rad, continuous (see :func:`unwrapped`).
        parameters: What counts as a rhythm.
    """
    chosen = parameters or HarmonicsParameters()
    knots, seen = np.asarray(times, dtype=float), np.asarray(rolls, dtype=float)
    span = float(knots[-1] - knots[0]) if len(knots) else 0.0
    longest = chosen.longest_share * span
    if len(knots) < 8 or longest <= chosen.shortest_period:
        return _smooth(knots, seen, chosen, 0.0)
    elapsed, weights = knots - knots[0], np.ones(len(knots))
    octaves = math.log2(longest / chosen.shortest_period)
    grid = np.geomspace(
        chosen.shortest_period, longest, max(2, math.ceil(octaves * chosen.periods_an_octave))
    )
    period, order = _search(elapsed, seen, weights, grid, chosen)
    for _ in range(3):  # what is far off is known only once there is a fit
        fitted, _ = _fitted(elapsed, seen, weights, np.array([period]), order)
        weights = _huber(seen - fitted[0], chosen.outlier)
        near = period * np.geomspace(0.9, 1 / 0.9, 9)
        period, order = _search(elapsed, seen, weights, np.union1d(grid, near[near <= longest]), chosen)
    fits, found = _fitted(elapsed, seen, weights, np.array([period]), order)
    fitted, coefficients = fits[0], found[0]
    centred = seen - np.average(seen, axis=0, weights=weights)
    left = float(weights @ np.sum((seen - fitted) ** 2, axis=1))
    explained = 1 - left / max(float(weights @ np.sum(centred**2, axis=1)), 1e-12)
    if explained < chosen.rhythm:
        return _smooth(knots, seen, chosen, explained)
    noise = _deviation(seen - fitted)
    return Harmonics(period, float(knots[0]), coefficients, knots, explained, noise)


def _search(
    elapsed: Vector, seen: Vector, weights: Vector, grid: Vector, parameters: HarmonicsParameters
) -> tuple[float, int]:
    """Period and number of harmonics with the smallest information criterion."""
    best = (math.inf, float(grid[0]), 1)
    most = max(1, min(parameters.most_harmonics, (len(elapsed) - 4) // 4))
    for order in range(1, most + 1):
        costs = _costs(elapsed, seen, weights, grid, order, parameters)
        for index in np.argsort(costs)[:2]:
            low, high = grid[max(0, index - 1)], grid[min(len(grid) - 1, index + 1)]
            for _ in range(2):  # a closer look between the neighbours
                near = np.geomspace(low, high, 15)
                there = _costs(elapsed, seen, weights, near, order, parameters)
                lowest = int(np.argmin(there))
                low, high = near[max(0, lowest - 1)], near[min(len(near) - 1, lowest + 1)]
            best = min(best, (float(there[lowest]), float(near[lowest]), order))
    return best[1], best[2]


def _costs(
    elapsed: Vector,
    seen: Vector,
    weights: Vector,
    periods: Vector,
    order: int,
    parameters: HarmonicsParameters,
) -> Vector:
    """(periods,) information criterion of each fit: n log(residual) + penalty x terms x log n, of all channels."""
    fitted, _ = _fitted(elapsed, seen, weights, periods, order)
    squares = np.einsum("f,pfk->p", weights, (seen - fitted) ** 2)
    count = seen.size
    terms = seen.shape[1] * (1 + 2 * order) + 1
    floor = 1e-8 * count  # a perfect fit is not infinitely good: below 0.006 deg nothing is gained
    return np.asarray(count * np.log(squares + floor) + parameters.penalty * terms * math.log(count))


def _fitted(
    elapsed: Vector, seen: Vector, weights: Vector, periods: Vector, order: int
) -> tuple[Vector, Vector]:
    """Weighted least squares for every period: the fits (p, F, k) and their coefficients (p, 1 + 2 order, k)."""
    waves = np.stack([design(elapsed, period, order) for period in periods])
    heavy = (waves * weights[:, None]).transpose(0, 2, 1)
    little = 1e-6 * len(elapsed) * np.eye(waves.shape[2])  # a gap in what was seen must not blow up
    coefficients = np.linalg.solve(heavy @ waves + little, heavy @ seen)
    return np.asarray(waves @ coefficients), np.asarray(coefficients)


def _deviation(residual: Vector) -> float:
    return 1.4826 * float(np.median(np.abs(residual)))


def _huber(residual: Vector, outlier: float) -> Vector:
    """(F,) weight of every frame, from its largest residual among the channels (F, k)."""
    scale = 1.4826 * np.median(np.abs(residual), axis=0) + math.radians(0.2)
    worst = np.max(np.abs(residual) / scale, axis=1)
    return np.asarray(np.minimum(1.0, outlier / np.maximum(worst, 1e-9)))


def _smooth(knots: Vector, seen: Vector, parameters: HarmonicsParameters, explained: float) -> Harmonics:
    """The motion itself, smoothed by a local line, for motions without a rhythm."""
    smooth = np.empty_like(seen)
    for index, now in enumerate(knots):
        apart = (knots - now) / parameters.smoothing
        kernel = np.exp(-0.5 * apart**2)
        line = np.stack([np.ones_like(apart), apart], axis=1)
        normal = (line * kernel[:, None]).T @ line + 1e-6 * np.eye(2)
        smooth[index] = np.linalg.solve(normal, (line * kernel[:, None]).T @ seen)[0]
    return Harmonics(
        None, float(knots[0]) if len(knots) else 0.0, smooth, knots, explained, _deviation(seen - smooth)
    )
