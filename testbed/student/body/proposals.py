"""New self-models from old: mutations at two scales, mirror images, re-parenting, swaps, crossings, fresh ones."""

from __future__ import annotations

import math

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.body._postures import Indices
from testbed.student.body.genomes import Genomes, all_trees, is_tree, random_tree
from testbed.student.body.self_model import Tree
from testbed.student.parameters import PlausibilityParameters

_FEW_LIMBS = 4
"""Up to here topologies are drawn from the list of all, evenly."""

COARSE, FINE = math.radians(40.0), math.radians(6.0)
"""The two scales of a mutation of a mounting angle: to another face of the body, and along a face."""


class Proposals:
    """Draws self-models.

    Args:
        limbs: How many limbs the student has.
        beliefs: How wide offsets and lengths are spread.
        rng: Source of all chance.
        outward: Whether a limb hangs on the main body or on a limb before it, or on any.
        elite: How many of the best have most of the offspring.
    """

    def __init__(
        self,
        limbs: int,
        beliefs: PlausibilityParameters,
        rng: np.random.Generator,
        *,
        outward: bool,
        elite: float,
    ) -> None:
        self._limbs, self._rng, self._outward = limbs, rng, outward
        self._elite = elite
        self._widths = beliefs.prior_widths(limbs)[limbs:]
        self._trees = [tree for tree in all_trees(limbs) if self._may_be(tree)] if limbs <= _FEW_LIMBS else []

    def from_prior(self, count: int) -> Genomes:
        """Bodies of any topology, evenly, with any angles."""
        rng, limbs = self._rng, self._limbs
        if self._trees:
            shuffled = [self._trees[i] for i in rng.permutation(len(self._trees)).tolist()]
            trees = [shuffled[i % len(shuffled)] for i in range(count)]
        else:
            trees = [random_tree(limbs, rng, outward=self._outward) for _ in range(count)]
        values = np.zeros((count, 3 * limbs))
        values[:, :limbs] = rng.uniform(-math.pi, math.pi, (count, limbs))
        return Genomes(np.array(trees, dtype=np.int64).reshape(count, limbs), values)

    def from_people(self, people: Genomes, log_posterior: Vector, count: int) -> Genomes:
        """Changed copies of the better self-models, and one in five that is new."""
        fresh = count // 5
        ranks = np.argsort(np.argsort(-log_posterior))
        chance = np.exp(-ranks / self._elite)
        rows = self._rng.choice(len(people), count - fresh, p=chance / chance.sum())
        parents, values = people.parents[rows].copy(), people.values[rows].copy()
        for tree, value in zip(parents, values, strict=True):
            self._change(tree, value, people)
        return Genomes.joined(Genomes(parents, values), self.from_prior(fresh))

    def everywhere(self, person: Genomes, limb: int) -> Genomes:
        """One self-model with one limb hung on every part that it may hang on, pointing in eight directions there.

        What hangs on the limb goes on pointing where it did.
        """
        parents, values = person.parents[0], person.values[0]
        before = pointing(parents, values, limb + 1)
        turn = float(self._rng.uniform(0, math.pi / 4))
        found = []
        for part in range(self._limbs + 1):
            tree = parents.copy()
            tree[limb] = part
            if part == limb + 1 or not self._may_be(tuple(tree.tolist())):
                continue
            for direction in turn + np.arange(8) * math.pi / 4:
                value = values.copy()
                value[limb] = direction
                value[np.flatnonzero(tree == limb + 1)] += before - pointing(tree, value, limb + 1)
                value[: self._limbs] = np.angle(np.exp(1j * value[: self._limbs]))
                found.append((tree, value))
        return Genomes(np.array([tree for tree, _ in found]), np.array([value for _, value in found]))

    def _change(self, tree: Indices, value: Vector, people: Genomes) -> None:
        """One or two changes of a self-model, in place."""
        rng, limbs = self._rng, self._limbs
        for _ in range(int(rng.integers(1, 3))):
            limb = int(rng.integers(limbs))
            before = pointing(tree, value, limb + 1)
            move = rng.choice(6, p=[0.25, 0.2, 0.2, 0.15, 0.1, 0.1])
            if move == 0:
                value[limb] += rng.normal(0.0, COARSE)
            elif move == 1:
                value[:limbs] += rng.normal(0.0, FINE, limbs)
                value[limbs:] += rng.normal(0.0, 0.3, 2 * limbs) * self._widths
            elif move == 2:  # the mirror image about the normal of a face
                value[limb] = rng.integers(4) * math.pi / 2 * 2 - value[limb]
            elif move == 3:
                self._hang_elsewhere(tree, value, limb)
            elif move == 4 and limbs > 1:
                self._swap(tree, value, limb, int(rng.choice([i for i in range(limbs) if i != limb])))
            else:
                value[limb] = people.values[int(rng.integers(len(people))), limb]
            if (
                move in (0, 2, 3, 5) and rng.random() < 0.5
            ):  # what hangs on the limb goes on pointing where it did
                value[np.flatnonzero(tree == limb + 1)] += before - pointing(tree, value, limb + 1)
        value[:limbs] = np.angle(np.exp(1j * value[:limbs]))

    def _hang_elsewhere(self, tree: Indices, value: Vector, limb: int) -> None:
        """Another parent; half of the time the limb goes on pointing where it did."""
        rng = self._rng
        before = int(tree[limb])
        others = [part for part in range(self._limbs + 1) if part not in (before, limb + 1)]
        if not others:
            return
        tree[limb] = rng.choice(others)
        if not self._may_be(tuple(tree.tolist())):
            tree[limb] = before
            return
        if rng.random() < 0.5:
            value[limb] += pointing(tree, value, before) - pointing(tree, value, int(tree[limb]))
        else:
            value[limb] = rng.uniform(-math.pi, math.pi)

    def _may_be(self, tree: Tree) -> bool:
        if self._outward:
            return all(parent <= limb for limb, parent in enumerate(tree))
        return is_tree(tree)

    def _swap(self, tree: Indices, value: Vector, one: int, other: int) -> None:
        """Two limbs change places: what hung on the one hangs on the other."""
        renamed = {one + 1: other + 1, other + 1: one + 1}
        old = [renamed.get(int(parent), int(parent)) for parent in tree]
        old[one], old[other] = old[other], old[one]
        if not self._may_be(tuple(old)):
            return
        tree[:] = old
        value[[one, other]] = value[[other, one]]


def pointing(tree: Indices, value: Vector, part: int) -> float:
    """Where a part of the flat body points, rad, counter-clockwise from the main body's x axis."""
    angle = 0.0
    while part:
        angle, part = angle + float(value[part - 1]), int(tree[part - 1])
    return angle
