"""What can be said of the body after self-discovery: weighted bodies, and what of them is known.

Section 3.2 ends with one genome. But a limb close to the middle of a face of the main body lifts it about the opposite
edge, and then the tilt depends on the cosine of the limb's angle from the face's normal alone: the mirror image
explains all that can be felt as well. So the record is a sample of bodies, and a list of what they agree on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.genomes import Genomes, body_of
from testbed.student.body.self_model import BodyPrior, Tree, limb_name
from testbed.student.body.settling import Settler, up_of_tilt
from testbed.student.parameters import PlausibilityParameters

_FACES = {0: "front", 90: "left", 180: "rear", 270: "right"}


@dataclass(frozen=True)
class FoldClass:
    """Bodies of one topology that lie together; several of them are what the student cannot tell apart.

    Attributes:
        parents: The topology.
        angles: (n,) their mean mounting angles, rad.
        spread: (n,) standard deviations, rad.
        probability: Their share of the posterior.
    """

    parents: Tree
    angles: Vector
    spread: Vector
    probability: float


@dataclass(frozen=True)
class History:
    """The most plausible self-model after one command.

    Attributes:
        parents: Its topology.
        angles: (n,) its mounting angles, rad.
        error: Root mean square angle between imagined and felt gravity over the commands so far, rad.
        evaluations: Self-models imagined so far.
    """

    parents: Tree
    angles: Vector
    error: float
    evaluations: int


@dataclass(frozen=True)
class SelfKnowledge:
    """What the student came to know of its body.

    Attributes:
        prior: What it knew beforehand.
        parents: On which part each limb hangs (0 the main body, i + 1 limb i) in the most plausible self-model.
        angles: (n,) its mounting angles, rad.
        offsets: (n,) what its servos add to commands, rad.
        stretches: (n,) how much longer its limbs are than believed beforehand, as factors.
        samples: (s,) bodies of the posterior.
        weights: (s,) their shares, summing to one.
        bias: (s, 2) the sensor's bias that goes with each, rad.
        fold_classes: Groups of samples, the most probable first.
        identifiable: (n,) whether the posterior names one place for the limb.
        commands: (m, n) rad.
        tilt: (m, 2) rad.
        history: One entry a command.
        evaluations: Self-models imagined in all.
        beliefs: What was held plausible.
    """

    prior: BodyPrior
    parents: Tree
    angles: Vector
    offsets: Vector
    stretches: Vector
    samples: Genomes
    weights: Vector
    bias: Vector
    fold_classes: tuple[FoldClass, ...]
    identifiable: tuple[bool, ...]
    commands: Vector
    tilt: Vector
    history: tuple[History, ...]
    evaluations: int
    beliefs: PlausibilityParameters

    @property
    def body(self) -> Morphology:
        """The most plausible body."""
        return body_of(self.prior, self.parents, self.angles, self.stretches)

    @property
    def stages(self) -> tuple[tuple[Tree, Vector], ...]:
        """The best topology and mounting angles (n,) rad of the search after each command, and what it came to."""
        return (*((entry.parents, entry.angles) for entry in self.history), (self.parents, self.angles))

    @property
    def errors(self) -> Vector:
        """The error of each, rad: root mean square angle between imagined and felt gravity; see :class:`History`."""
        commands, felt, body = self.commands + self.offsets, up_of_tilt(self.tilt), Settler(self.body)
        imagined = body.stays(commands, felt) if self.beliefs.in_place else up_of_tilt(body.tilt(commands))
        apart = np.arccos(np.clip(np.sum(imagined * felt, axis=-1), -1, 1))
        return np.array([*(entry.error for entry in self.history), float(np.sqrt(np.mean(apart**2)))])

    @property
    def trees(self) -> dict[Tree, float]:
        """How probable each topology is, the most probable first."""
        shares: dict[Tree, float] = {}
        for tree, weight in zip(self.samples.trees, self.weights.tolist(), strict=True):
            shares[tree] = shares.get(tree, 0.0) + weight
        return dict(sorted(shares.items(), key=lambda item: -item[1]))

    def holds(self, parents: Tree, angles: Vector, *, level: float = 0.99, blur_deg: float = 1.5) -> bool:
        """Whether a body lies in the credible set: its topology, and every angle, belongs to the likeliest ``level``.

        Args:
            parents: A topology.
            angles: (n,) mounting angles, rad.
            level: Share of the posterior in the set.
            blur_deg: Samples are smoothed by a kernel at least so wide.
        """
        if self.trees.get(parents, 0.0) < 1 - level:
            return False
        mine = [row for row, tree in enumerate(self.samples.trees) if tree == parents]
        weights = self.weights[mine] / self.weights[mine].sum()
        width = max(math.radians(blur_deg), 0.0)
        for limb, angle in enumerate(angles):
            places = self.samples.angles[mine, limb]
            dense = np.exp(-0.5 * (_apart(places[:, None], places[None]) / width) ** 2) @ weights
            here = float(np.exp(-0.5 * (_apart(places, float(angle)) / width) ** 2) @ weights)
            order = np.argsort(dense)
            floor = dense[order][np.searchsorted(np.cumsum(weights[order]), 1 - level)]
            # The truth is no sample: at the rim of a smoothed set it sees half of what a sample there sees.
            if here < 0.5 * floor:
                return False
        return True

    def simplest(self, grid: float) -> SelfKnowledge:
        """The same knowledge with the simplest self-model that it leaves open.

        Near the face normal of the main body tilt says nothing about an angle (the mirror fold), and the best of many
        equally plausible angles is an accident of noise. Whatever whole multiple of ``grid`` (rad) lies in the credible
        set is taken instead, angle by angle. It is a prior, and it suits bodies that people build; 0 leaves it out.
        """
        angles = self.angles.copy()
        if not grid:
            return self
        for limb, angle in enumerate(self.angles):
            rounded = angles.copy()
            rounded[limb] = round(float(angle) / grid) * grid
            if self.holds(self.parents, rounded):
                angles = rounded
        return replace(self, angles=angles)

    def words(self) -> list[str]:
        """What is known and what is not, in plain words."""
        first = self.fold_classes[0]
        images = [
            self._image(first, other)
            for other in self.fold_classes[1:]
            if other.parents == first.parents and other.probability > 0.05
        ]
        return [self._where(limb) for limb in range(len(self.parents))] + images

    def _where(self, limb: int) -> str:
        shares: dict[int, float] = {}
        for parents, weight in zip(
            self.samples.parents[:, limb].tolist(), self.weights.tolist(), strict=True
        ):
            shares[parents] = shares.get(parents, 0.0) + weight
        likely = sorted(((share, part) for part, share in shares.items() if share > 0.02), reverse=True)
        places = " or ".join(f"{part_name(part)} ({share:.0%})" for share, part in likely)
        angle = math.degrees(self.angles[limb])
        if self.identifiable[limb]:
            sure = math.degrees(self.fold_classes[0].spread[limb])
            return f"{limb_name(limb)} hangs on {places} at {angle:.0f} deg, give or take {sure:.0f}"
        return (
            f"{limb_name(limb)} hangs on {places}; its angle is not known, {angle:.0f} deg is one of several"
        )

    def _image(self, first: FoldClass, other: FoldClass) -> str:
        first_angles = np.degrees(first.angles).round().astype(int).tolist()
        other_angles = np.degrees(other.angles).round().astype(int).tolist()
        same = (
            f"angles {other_angles} explain what was felt as well as {first_angles} ({other.probability:.0%})"
        )
        middle = np.degrees(np.angle(np.exp(1j * first.angles) + np.exp(1j * other.angles)))
        moved = np.degrees(_apart(first.angles, other.angles)) > 8
        for limb, parent in enumerate(self.parents):
            if parent == 0 and moved[limb]:
                face = int(round(float(middle[limb]) / 90) * 90) % 360
                if abs((float(middle[limb]) - face + 180) % 360 - 180) < 8:
                    return f"{same}: mirror images about the normal of the {_FACES[face]} face"
        return same


def part_name(part: int) -> str:
    """main, limb_a, limb_b, ..."""
    return limb_name(part - 1) if part else "main"


def _apart(one: Vector, other: Vector | float) -> Vector:
    """Smallest angles between directions, rad."""
    return np.asarray(np.abs(np.angle(np.exp(1j * (one - other)))))


def fold_classes(samples: Genomes, weights: Vector, *, width: float) -> tuple[FoldClass, ...]:
    """Groups of samples: of one topology, none further than ``width`` (rad, in any angle) from a neighbour's chain."""
    trees = samples.trees
    label = np.full(len(samples), -1)
    groups: list[list[int]] = []
    order = np.argsort(-weights)
    # The faint ones between two groups would chain them together: they are left out, and counted where they are near.
    worthy = order[: int(np.searchsorted(np.cumsum(weights[order]), 0.95)) + 1].tolist()
    for seed in worthy:
        if label[seed] >= 0:
            continue
        group, frontier = [seed], [seed]
        label[seed] = len(groups)
        while frontier:
            here = frontier.pop()
            near = _apart(samples.angles, samples.angles[here]).max(axis=1) < width
            for row in worthy:
                if label[row] < 0 and near[row] and trees[row] == trees[here]:
                    label[row] = len(groups)
                    group.append(row)
                    frontier.append(row)
        groups.append(group)
    for row in order[len(worthy) :].tolist():
        kin = [group for group in groups if trees[group[0]] == trees[row]]
        if kin and weights[row] > 0:
            min(
                kin, key=lambda group: _apart(samples.angles[group], samples.angles[row]).max(axis=1).min()
            ).append(row)
    classes = []
    for group in groups:
        share = weights[group]
        mean = np.angle((np.exp(1j * samples.angles[group]) * share[:, None]).sum(axis=0))
        off = _apart(samples.angles[group], mean)
        spread = np.sqrt((off**2 * share[:, None]).sum(axis=0) / share.sum())
        classes.append(FoldClass(trees[group[0]], mean, spread, float(share.sum())))
    classes.sort(key=lambda one: -one.probability)
    return tuple(classes)
