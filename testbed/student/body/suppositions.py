"""One thing that may have happened to the body, and samples of the bodies to which it may have happened.

A sample is a whole body and the angle at which its joint is stuck, if one is: what was felt while all was well bounds
it as much as what is felt since. The posterior is sampled sequentially (Del Moral, Doucet and Jasra 2006): each reading
is let in by degrees, samples that explain it badly give way to copies of better ones, and all are moved about by Markov
chains whose steps are differences of other samples (ter Braak 2006) or hang a limb elsewhere. On the way comes out how
well the supposition as a whole foresaw the readings, so that suppositions can be compared.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import logsumexp

from testbed.bodies.morphology import Vector
from testbed.student.body._postures import Indices
from testbed.student.body.damage_report import DamageKind, suffered
from testbed.student.body.genomes import Foresight, Genomes, is_tree
from testbed.student.body.plausibility import Felt, judge_bodies
from testbed.student.body.posterior import SelfKnowledge

_COUNTING = 0.5
"""A reading is let in by degrees so small that at least this share of the samples still counts after each."""
_ELSEWHERE = 0.1
"""Share of the steps that hang a limb elsewhere, at any angle; the others are differences of samples."""
_WHOLE_STEP = 0.1
"""Share of the differences that are taken whole, from one group of samples into another (ter Braak 2006)."""


class Supposition:
    """That something happened: a limb was lost, a joint locked, or nothing at all.

    Args:
        kind: What.
        limb: Which limb is gone, or which limb's joint is locked; -1 for nothing.
        log_prior: How probable that is beforehand.
        knowledge: What self-discovery found; samples start as its bodies.
        count: How many samples.
        mind: Imagines tilt.
        rng: Source of chance.

    Attributes:
        bodies: (s,) as they were before it happened.
        places: (s,) where the joint is stuck, rad; of no meaning where none is.
        log_evidence: How probable the supposition is given all that was told, up to a constant.
    """

    def __init__(
        self,
        kind: DamageKind,
        limb: int,
        log_prior: float,
        knowledge: SelfKnowledge,
        count: int,
        mind: Foresight,
        rng: np.random.Generator,
    ) -> None:
        self.kind, self.limb, self.log_evidence = kind, limb, log_prior
        self._beliefs, self._mind, self._rng = knowledge.beliefs, mind, rng
        self._felt, self._before = Felt(knowledge.commands, knowledge.tilt), len(knowledge.commands)
        self.bodies = knowledge.samples.take(_evenly(knowledge.weights, count, rng))
        # Where no known body has a limb that hangs on a later one, none is thought of.
        self._outward = bool(np.all(knowledge.samples.parents <= np.arange(self.bodies.limbs)))
        self._travel = tuple(knowledge.prior.limits[max(limb, 0)].tolist())
        self.places: Vector = rng.permutation(np.linspace(self._travel[0], self._travel[1], count))
        self._ups = self._imagined(self.bodies, self.places)

    def tell(self, command: Vector, tilt: Vector, moves: int) -> None:
        """Learn from a tilt (2,) rad after a command (n,) rad; samples step so many times at each degree."""
        self._felt = self._felt.with_reading(command, tilt)
        newest = self._mind.feel(*self._suffering(self.bodies, self.places, command[None]))
        self._ups = np.concatenate([self._ups, newest], axis=1)
        degree = 0.0
        while degree < 1.0:
            before, after = self._heights(self.bodies, self._ups)
            gain = after - before
            step = _degrees(gain, 1.0 - degree)
            self.log_evidence += float(logsumexp(step * gain)) - math.log(len(gain))
            rows = _evenly(np.exp(step * gain - logsumexp(step * gain)), len(gain), self._rng)
            self.bodies, self.places, self._ups = self.bodies.take(rows), self.places[rows], self._ups[rows]
            degree += step
            for _ in range(moves):
                self._move(degree)

    def foresee(self, rows: Indices, commands: Vector) -> tuple[Vector, Vector]:
        """What some of the samples would feel after further commands; see :meth:`Foresight.foresee`."""
        return self._mind.foresee(*self._suffering(self.bodies.take(rows), self.places[rows], commands))

    @property
    def place(self) -> float | None:
        """Where the joint is stuck, rad: the middle of the samples; None if none is."""
        return float(np.median(self.places)) if self.kind == "joint_locked" else None

    def bias(self) -> Vector:
        """(s, 2) what the sensor adds, as goes best with each sample, rad."""
        return judge_bodies(self._ups, self.bodies.values, self._felt, self._beliefs).bias

    def _heights(self, bodies: Genomes, ups: Vector) -> tuple[Vector, Vector]:
        """(s,) log posteriors without the newest reading, and with it."""
        earlier = Felt(self._felt.commands[:-1], self._felt.tilt[:-1])
        without = judge_bodies(ups[:, :-1], bodies.values, earlier, self._beliefs)
        return without.log_posterior, judge_bodies(
            ups, bodies.values, self._felt, self._beliefs
        ).log_posterior

    def _move(self, degree: float) -> None:
        """Every sample makes one step, or stays; the newest reading counts to this degree."""
        bodies, places = self._steps()
        inside = (self._travel[0] <= places) & (places <= self._travel[1])
        rows = np.flatnonzero(inside)
        ups = self._imagined(bodies.take(rows), places[rows])
        here, there = (
            (1 - degree) * before + degree * after
            for before, after in (
                self._heights(self.bodies.take(rows), self._ups[rows]),
                self._heights(bodies.take(rows), ups),
            )
        )
        taken = np.log(self._rng.random(len(rows))) < there - here
        gone = rows[taken]
        self.bodies.parents[gone], self.bodies.values[gone] = bodies.parents[gone], bodies.values[gone]
        self.places[gone], self._ups[gone] = places[gone], ups[taken]

    def _steps(self) -> tuple[Genomes, Vector]:
        """Where every sample would step to: all steps are as likely as the way back."""
        rng, count, limbs = self._rng, len(self.places), self.bodies.limbs
        one, other = rng.integers(count, size=(2, count))
        boldness = 2.38 / math.sqrt(2 * (3 * limbs + 1)) * rng.uniform(0.3, 1.0, count)
        boldness[rng.random(count) < _WHOLE_STEP] = 1.0
        hung = np.flatnonzero(rng.random(count) < _ELSEWHERE)
        boldness[hung] = 0.0
        places = self.places + boldness * (self.places[one] - self.places[other])
        way = self.bodies.values[one] - self.bodies.values[other]
        way[:, :limbs] = np.angle(np.exp(1j * way[:, :limbs]))
        parents, values = self.bodies.parents.copy(), self.bodies.values + boldness[:, None] * way
        for row, limb in zip(hung, rng.integers(limbs, size=len(hung)), strict=True):
            before = parents[row, limb]
            parents[row, limb] = rng.choice(limb + 1 if self._outward else limbs + 1)
            if not is_tree(tuple(parents[row].tolist())):
                parents[row, limb] = before
            values[row, limb] = rng.uniform(-math.pi, math.pi)
        values[:, :limbs] = np.angle(np.exp(1j * values[:, :limbs]))
        return Genomes(parents, values), places

    def _imagined(self, bodies: Genomes, places: Vector) -> Vector:
        """(s, m, 3) the up directions that bodies would have felt after all commands: at first whole, then not."""
        commands, before = self._felt.commands, self._before
        whole = self._mind.feel(bodies, commands[:before])
        since = self._mind.feel(*self._suffering(bodies, places, commands[before:]))
        return np.concatenate([whole, since], axis=1)

    def _suffering(self, bodies: Genomes, places: Vector, commands: Vector) -> tuple[Genomes, Vector, Vector]:
        broken, gains = suffered(bodies, self.kind, self.limb, places)
        return broken, commands, gains


def _degrees(gain: Vector, most: float) -> float:
    """How much of a reading can be let in at once, at most all that is left of it.

    Args:
        gain: (s,) what the whole reading adds to the log posterior of each sample.
        most: What is left of it.
    """

    def counting(degree: float) -> float:
        weights = np.exp(degree * (gain - gain.max()))
        return float(weights.sum() ** 2 / np.sum(weights**2) / len(gain))

    low, high = 0.0, most
    if counting(most) >= _COUNTING:
        return most
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if counting(middle) >= _COUNTING else (low, middle)
    return max(low, 1e-6)


def _evenly(weights: Vector, count: int, rng: np.random.Generator) -> Indices:
    """(count,) rows in proportion to weights that sum to one, as evenly as can be."""
    marks = (np.arange(count) + rng.random()) / count
    rows = np.minimum(np.searchsorted(np.cumsum(weights), marks), len(weights) - 1)
    return np.asarray(rows, dtype=np.int64)
