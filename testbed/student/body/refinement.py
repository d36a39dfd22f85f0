"""Downhill with several self-models at once: damped Gauss-Newton steps (Levenberg and Marquardt), robustly weighted.

The derivatives of an imagined tilt by a genome's values come from nudging each of them: 3 n evaluations a step for n
limbs, which is far less than a blind search needs for the same gain.
"""

from __future__ import annotations

import math

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.body.genomes import Foresight, Genomes
from testbed.student.body.plausibility import Felt, judge_bodies
from testbed.student.parameters import PlausibilityParameters

_NUDGE = math.radians(0.5)
_LONGEST = math.radians(30.0)
_TOGETHER = 4
_FAR = 4.0
"""Whoever is wrong by more than this, in the sensor's spreads, moves its angles alone, at a third of the cost."""


class Refinement:
    """Remembers how boldly each self-model steps, and which one has arrived.

    Args:
        mind: Imagines tilt.
        beliefs: What is plausible.
    """

    def __init__(self, mind: Foresight, beliefs: PlausibilityParameters) -> None:
        self._mind, self._beliefs = mind, beliefs
        self._damping: dict[bytes, float] = {}
        self._arrived: dict[bytes, int] = {}
        self._curvature: dict[bytes, Vector] = {}

    def forget(self, kept: list[int]) -> None:
        """Nothing is kept by row, so nothing moves when rows do; memory stays small."""
        if len(self._damping) > 50 * len(kept):
            self._damping.clear()
            self._arrived.clear()
            self._curvature.clear()

    def spread_of(self, values: Vector, widest: float) -> Vector | None:
        """Covariance of a self-model's values as its last step saw it; None if it never stepped.

        Args:
            values: (3 n,) of the self-model.
            widest: No direction is taken to be more uncertain than this standard deviation.
        """
        curvature = self._curvature.get(values.tobytes())
        if curvature is None:
            return None
        return np.asarray(np.linalg.inv(curvature + np.eye(len(curvature)) / widest**2))

    def covariances(self, people: Genomes, ups: Vector, felt: Felt, widest: float) -> Vector:
        """(p, 3 n, 3 n) covariances of self-models' values, seen afresh; see :meth:`spread_of`."""
        slopes = self.slopes(people, ups, felt, people.values.shape[1])
        fit = judge_bodies(ups, people.values, felt, self._beliefs)
        size = people.values.shape[1]
        covariances = np.empty((len(people), size, size))
        for one in range(len(people)):
            normal, _ = self.normal_equations(
                slopes[one], fit.residuals[one], fit.weights[one], felt, people.values[one]
            )
            normal[np.arange(size), np.arange(size)] += 1 / widest**2
            covariances[one] = np.linalg.inv(normal)[:size, :size]
        return covariances

    def choose(self, people: Genomes, log_posterior: Vector, budget: int) -> list[int]:
        """Who steps next, a few at once: the best of each topology that is still in the race, then the others."""
        cost = people.values.shape[1] + 1
        many = min(_TOGETHER, budget // cost)
        seen: dict[tuple[int, ...], int] = {}
        ranked = []
        trees = people.trees
        for row in np.argsort(-log_posterior).tolist():
            seen[trees[row]] = seen.get(trees[row], 0) + 1
            if self._arrived.get(people.values[row].tobytes(), 0) < 2:
                # a nat of log posterior or a place in the queue of one's own topology weigh about the same
                ranked.append(
                    (0.3 * float(log_posterior.max() - log_posterior[row]) + 3 * seen[trees[row]], row)
                )
        return [row for _, row in sorted(ranked)[:many]]

    def step(self, people: Genomes, ups: Vector, felt: Felt, rows: list[int]) -> tuple[Genomes, Vector]:
        """One step each; whoever would be worse off stays.

        Args:
            people: Self-models.
            ups: (p, m, 3) what they would have felt.
            felt: What was felt.
            rows: Unused names of the self-models; their values identify them.

        Returns:
            The self-models and their ``ups`` afterwards.
        """
        fit = judge_bodies(ups, people.values, felt, self._beliefs)
        far = np.median(np.linalg.norm(fit.residuals, axis=2), axis=1) > _FAR * self._beliefs.spread
        slopes = np.zeros((*ups.shape, people.values.shape[1]))
        for group, columns in ((far, people.limbs), (~far, people.values.shape[1])):
            if group.any():
                members = people.take(np.flatnonzero(group))
                slopes[group, :, :, :columns] = self.slopes(members, ups[group], felt, columns)
        trial = people.values.copy()
        curvatures: list[Vector] = []
        for one in range(len(people)):
            damping = self._damping.get(people.values[one].tobytes(), 0.1)
            normal, pull = self.normal_equations(
                slopes[one], fit.residuals[one], fit.weights[one], felt, people.values[one]
            )
            curvature = normal[: trial.shape[1], : trial.shape[1]].copy()
            curvatures.append(curvature)
            normal += damping * np.diag(np.diag(normal)) + 1e-6 * np.eye(len(normal))
            way = np.linalg.solve(normal, pull)[: trial.shape[1]]
            way *= min(1.0, _LONGEST / max(1e-12, float(np.abs(way).max())))
            trial[one] += way
        limbs = people.limbs
        trial[:, :limbs] = np.angle(np.exp(1j * trial[:, :limbs]))
        trial[:, limbs:] = np.clip(trial[:, limbs:], -0.6, 0.6)
        there = self._mind.relive(Genomes(people.parents, trial), felt, self._beliefs)
        after = judge_bodies(there, trial, felt, self._beliefs)
        gain = after.log_posterior - fit.log_posterior
        values, result = people.values.copy(), ups.copy()
        for one in range(len(people)):
            key = people.values[one].tobytes()
            damping, arrived = self._damping.pop(key, 0.1), self._arrived.pop(key, 0)
            if gain[one] > 0:
                values[one], result[one] = trial[one], there[one]
                key, damping = trial[one].tobytes(), max(1e-3, damping / 5)
                arrived = arrived + 1 if gain[one] < 0.02 else 0
            else:
                damping, arrived = min(1e3, damping * 8), arrived + 1
            self._damping[key], self._arrived[key] = damping, arrived
            self._curvature[key] = curvatures[one]
        return Genomes(people.parents, values), result

    def slopes(self, people: Genomes, ups: Vector, felt: Felt, size: int) -> Vector:
        """(p, m, 3, size) derivatives of the imagined up direction by the first ``size`` of the genomes' values."""
        nudged = people.repeat(size)
        nudges = _NUDGE * np.eye(size, people.values.shape[1])
        nudged = Genomes(nudged.parents, nudged.values + np.tile(nudges, (len(people), 1)))
        there = self._mind.relive(nudged, felt, self._beliefs).reshape(len(people), size, *ups.shape[1:])
        change = (there - ups[:, None]) / _NUDGE
        torn = np.abs(change).max(axis=3, keepdims=True) > 10.0  # the nudge made it topple: no derivative
        return np.moveaxis(np.where(torn, 0.0, change), 1, 3)

    def normal_equations(
        self, slopes: Vector, residuals: Vector, weights: Vector, felt: Felt, values: Vector
    ) -> tuple[Vector, Vector]:
        """Curvature and pull of the log posterior of one self-model, its sensor's bias in the last two places."""
        limbs = len(values) // 3
        design = np.concatenate([slopes, felt.bias_effect], axis=2)
        normal = np.einsum("m,mij,mik->jk", weights, design, design)
        pull = -np.einsum("m,mij,mi->j", weights, design, residuals)
        rigid = 1 / self._beliefs.prior_widths(limbs) ** 2
        normal[np.arange(3 * limbs), np.arange(3 * limbs)] += rigid
        pull[: 3 * limbs] -= rigid * values
        normal[3 * limbs :, 3 * limbs :] += np.eye(2) / np.radians(self._beliefs.bias_deg) ** 2
        return normal, pull
