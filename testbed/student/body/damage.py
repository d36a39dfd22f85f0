"""When the body changes in the middle of life: the student notices, says what broke, and models itself anew.

Section 3.2 discovers a body once; Bongard, Zykov and Lipson (2006) let a robot recover from the loss of a leg. Here the
posterior of self-discovery foresees every tilt. Against "nothing has changed" stand the hypotheses that limb i is
gone (with all that hung on it) or that joint j no longer moves, at some angle. All are followed by Bayes' rule, each
with several bodies of the posterior; before each command any of them may have come true. Commands are those that tell
most about which it is::

    check = SelfCheck(knowledge, parameters, rng)
    command = check.next_command()
    ...lie flat, move there, wait...
    surprise = check.tell(command, tilt)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from testbed.bodies.morphology import Vector
from testbed.student.body.commands import worth_of
from testbed.student.body.damage_report import DamageKind, DamageReport, suffered
from testbed.student.body.genomes import Foresight, Genomes
from testbed.student.body.posterior import SelfKnowledge
from testbed.student.body.settling import up_of_tilt
from testbed.student.parameters import DamageParameters


@dataclass(frozen=True)
class Hypothesis:
    """Something that may have happened.

    Attributes:
        kind: What.
        limb: Which limb is gone, or which limb's joint is locked; -1 for nothing.
        angle: Where it is locked, rad.
    """

    kind: DamageKind
    limb: int = -1
    angle: float = 0.0


@dataclass(frozen=True)
class Surprise:
    """Something is wrong.

    Attributes:
        kind: What it most probably is.
        limb: Which limb, or the limb that the joint moves.
        probability: How probable this kind and limb are.
        broken: How probable it is that anything has happened at all.
    """

    kind: DamageKind
    limb: int
    probability: float
    broken: float


class SelfCheck:
    """Ask :meth:`next_command`, do it from lying flat, :meth:`tell`; :meth:`record` at any time.

    Args:
        knowledge: What self-discovery found.
        parameters: What is open.
        rng: Source of all chance.
    """

    def __init__(
        self, knowledge: SelfKnowledge, parameters: DamageParameters, rng: np.random.Generator
    ) -> None:
        self._knowledge, self._parameters, self._rng = knowledge, parameters, rng
        self.mind = Foresight(knowledge.prior)
        low, high = knowledge.prior.limits.T
        limbs = len(low)
        self.hypotheses = [Hypothesis("none")]
        self.hypotheses += [Hypothesis("limb_lost", limb) for limb in range(limbs)]
        for limb in range(limbs):
            places = np.linspace(low[limb], high[limb], parameters.locked_angles + 2)[1:-1]
            self.hypotheses += [Hypothesis("joint_locked", limb, float(place)) for place in places]
        self._break = self._prior()
        rows = rng.choice(len(knowledge.weights), parameters.bodies, p=knowledge.weights)
        self._bodies, self._bias = knowledge.samples.take(rows), knowledge.bias[rows]
        self._genomes, self._gains = self._imagined()
        # (hypotheses, bodies): the log probability of each pair given all that was felt
        self._log = np.full((len(self.hypotheses), parameters.bodies), -np.inf)
        self._log[0] = -math.log(parameters.bodies)
        self._told = 0
        self._noticed: int | None = None

    def next_command(self) -> Vector:
        """(n,) rad: the command of a pool whose outcome tells most between the hypotheses."""
        parameters = self._parameters
        probability = np.exp(self._hazarded() - logsumexp(self._hazarded()))
        intact, broken = probability[0].sum(), probability[1:].sum()
        share = max(parameters.design_share, float(broken))
        probability[0] *= (1 - share) / intact
        probability[1:] *= share / broken
        pool = parameters.commands.draw(self._knowledge.prior.limits, parameters.pool, self._rng)
        ups, haste = self.mind.foresee(self._genomes, pool, self._gains)
        return np.asarray(
            pool[int(np.argmax(worth_of(probability.ravel(), ups, haste, self._spread, parameters.commands)))]
        )

    def tell(self, command: Vector, tilt: Vector) -> Surprise | None:
        """Learn from the tilt (2,) rad felt after a command (n,) rad; says so if something is wrong."""
        self._told += 1
        ups = self.mind.feel(self._genomes, np.asarray(command, dtype=float)[None], self._gains)[:, 0]
        felt = up_of_tilt(np.asarray(tilt, dtype=float) - np.tile(self._bias, (len(self.hypotheses), 1)))
        squares = np.sum((ups - felt) ** 2, axis=1).reshape(self._log.shape) / self._spread**2
        freedom = self._knowledge.beliefs.freedom + 2  # the sensor's tail; toppling is the outlier's part
        likelihood = (1 + squares / freedom) ** (-(freedom + 2) / 2) / (2 * math.pi * self._spread**2)
        elsewhere = self._parameters.outlier / (2 * math.pi)  # anywhere on the upper half of the sphere
        self._log = self._hazarded() + np.log((1 - self._parameters.outlier) * likelihood + elsewhere)
        self._log -= logsumexp(self._log)
        surprise = self._surprise()
        if surprise.broken < self._parameters.alarm:
            return None
        self._noticed = self._told if self._noticed is None else self._noticed
        return surprise

    def record(self) -> DamageReport:
        """What is believed now."""
        surprise = self._surprise()
        knowledge = self._knowledge
        intact = surprise.broken < self._parameters.alarm
        kind: DamageKind = "none" if intact else surprise.kind
        limb = -1 if intact else surprise.limb
        angle = self._locked_angle(limb) if kind == "joint_locked" else None
        share = 1 - surprise.broken if intact else surprise.probability
        noticed = None if intact else self._noticed
        return DamageReport.of(knowledge, kind, limb, angle, share, noticed)

    @property
    def _spread(self) -> float:
        return self._knowledge.beliefs.spread

    def _prior(self) -> Vector:
        """(hypotheses,) logarithms of what breaks if anything does: any limb, half of the time lost, half locked."""
        limbs = len(self._knowledge.parents)
        shares = {
            "none": 0.0,
            "limb_lost": 0.5 / limbs,
            "joint_locked": 0.5 / limbs / self._parameters.locked_angles,
        }
        with np.errstate(divide="ignore"):
            return np.log([shares[hypothesis.kind] for hypothesis in self.hypotheses])

    def _hazarded(self) -> Vector:
        """The log probabilities before the next command: a little of "nothing" has become each damage."""
        hazard = self._parameters.hazard
        moved = self._log.copy()
        moved[0] += math.log1p(-hazard)
        return np.asarray(np.logaddexp(moved, self._log[0] + math.log(hazard) + self._break[:, None]))

    def _imagined(self) -> tuple[Genomes, Vector]:
        """Every hypothesis with every body, and how much of its command each servo follows."""
        imagined = [suffered(self._bodies, one.kind, one.limb, one.angle) for one in self.hypotheses]
        return Genomes.joined(*(bodies for bodies, _ in imagined)), np.concatenate(
            [gains for _, gains in imagined]
        )

    def _surprise(self) -> Surprise:
        probability = np.exp(self._log).sum(axis=1)
        shares: dict[tuple[DamageKind, int], float] = {}
        for hypothesis, share in zip(self.hypotheses[1:], probability[1:].tolist(), strict=True):
            key = (hypothesis.kind, hypothesis.limb)
            shares[key] = shares.get(key, 0.0) + share
        limbs: dict[int, float] = {}
        for (_, limb), share in shares.items():
            limbs[limb] = limbs.get(limb, 0.0) + share
        limb = max(limbs, key=lambda one: limbs[one])
        kind, _ = max((key for key in shares if key[1] == limb), key=lambda key: shares[key])
        return Surprise(kind, limb, shares[kind, limb], float(probability[1:].sum()))

    def _locked_angle(self, limb: int) -> float:
        probability = np.exp(self._log).sum(axis=1)
        rows = [i for i, one in enumerate(self.hypotheses) if one.kind == "joint_locked" and one.limb == limb]
        angles = np.array([self.hypotheses[row].angle for row in rows])
        return float(angles @ probability[rows] / probability[rows].sum())
