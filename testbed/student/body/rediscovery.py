"""After damage the student models itself anew, from what it knew and from further commands.

Bongard, Zykov and Lipson (2006) start their search again with the damaged body. Here nothing that was learnt is
thrown away: against "all is well after all" stand all limbs that may be lost and all joints that may be stuck, at any
angle, each a :class:`~testbed.student.body.suppositions.Supposition` with bodies of its own; commands are those whose
outcome tells them and their bodies apart::

    again = Rediscovery(knowledge, noticed, parameters, own, rng)
    again.tell(command, tilt)  # the reading by which it was noticed
    while again.wants_more:
        command = again.next_command()
        ...lie flat, move there, wait...
        again.tell(command, tilt)
    report = again.record()
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.special import softmax

from testbed.bodies.morphology import Vector
from testbed.student.body.commands import worth_of
from testbed.student.body.damage_report import DamageKind, DamageReport, damage_in_words
from testbed.student.body.genomes import Foresight, Genomes
from testbed.student.body.posterior import SelfKnowledge, fold_classes
from testbed.student.body.suppositions import Supposition
from testbed.student.parameters import ActiveDiscoveryParameters, RediscoveryParameters


class Rediscovery:
    """:meth:`tell` what was noticed; ask :meth:`next_command`, do it, :meth:`tell`; at the end, :meth:`record`.

    Args:
        knowledge: What self-discovery found.
        noticed: What the check for damage made of it.
        parameters: What is open.
        own: What was open in self-discovery.
        rng: Source of all chance.
    """

    def __init__(
        self,
        knowledge: SelfKnowledge,
        noticed: DamageReport,
        parameters: RediscoveryParameters,
        own: ActiveDiscoveryParameters,
        rng: np.random.Generator,
    ) -> None:
        self._knowledge, self._noticed = knowledge, noticed
        self._parameters, self._own, self._rng = parameters, own, rng
        self._told = 0
        self.mind = Foresight(knowledge.prior)
        limbs = len(knowledge.parents)
        # Beforehand it is as likely as not that anything happened, and then all that can happen is alike.
        kinds: tuple[DamageKind, ...] = ("limb_lost", "joint_locked")
        may_be: list[tuple[DamageKind, int, float]] = [("none", -1, math.log(0.5))]
        may_be += [(kind, limb, math.log(0.25 / limbs)) for kind in kinds for limb in range(limbs)]
        self.suppositions = [
            Supposition(kind, limb, log_prior, knowledge, parameters.bodies, self.mind, rng)
            for kind, limb, log_prior in may_be
        ]

    @property
    def wants_more(self) -> bool:
        """Whether fewer commands were told, after the one that gave the alarm, than planned."""
        return self._told <= self._parameters.commands

    @property
    def shares(self) -> Vector:
        """(suppositions,) how probable each is."""
        return np.asarray(softmax([one.log_evidence for one in self.suppositions]))

    def next_command(self) -> Vector:
        """(n,) rad: of a pool the command whose outcome tells most: which supposition holds, and with what body."""
        parameters, limits = self._parameters, self._knowledge.prior.limits
        pool = parameters.choice.draw(limits, parameters.pool, self._rng)
        votes = self._votes()
        heard = [
            (one, share, math.ceil(share * parameters.voters))
            for one, share in zip(self.suppositions, votes.tolist(), strict=True)
            if share * parameters.voters > 0.1
        ]
        foreseen = [
            one.foresee(
                self._rng.choice(parameters.bodies, min(count, parameters.bodies), replace=False), pool
            )
            for one, _, count in heard
        ]
        ups, haste = (np.concatenate(parts) for parts in zip(*foreseen, strict=True))
        weights = np.concatenate(
            [
                np.full(len(ups), share / len(ups))
                for (_, share, _), (ups, _) in zip(heard, foreseen, strict=True)
            ]
        )
        worth = worth_of(weights, ups, haste, self._knowledge.beliefs.spread, parameters.choice)
        return np.asarray(pool[int(np.argmax(worth))])

    def tell(self, command: Vector, tilt: Vector) -> None:
        """Learn from the tilt (2,) rad, felt after a command (n,) rad that was given to the body lying flat."""
        self._told += 1
        for one in self.suppositions:
            one.tell(np.asarray(command, dtype=float), np.asarray(tilt, dtype=float), self._parameters.moves)

    def record(self) -> DamageReport:
        """What is believed now."""
        shares = self.shares
        best, second = np.argsort(-shares)[:2].tolist()
        one, other = self.suppositions[best], self.suppositions[second]
        itself = renewed(self._knowledge, one.bodies, one.bias(), self._own)
        or_else = None
        if shares[second] > self._parameters.doubt:
            or_else = damage_in_words(itself.parents, other.kind, other.limb, other.place, shares[second])
        return DamageReport.of(
            itself,
            one.kind,
            one.limb,
            one.place,
            float(shares[best]),
            self._noticed.noticed_after,
            at_first=self._noticed,
            or_else=or_else,
        )

    def _votes(self) -> Vector:
        """(suppositions,) how much each has to say: as probable as it is, but the likeliest leaves room for others."""
        shares = self.shares
        best, floor = int(np.argmax(shares)), 0.1 / len(shares)
        others = np.delete(shares, best) + floor
        room = max(self._parameters.design_share, 1 - float(shares[best]))
        return np.insert(room * others / others.sum(), best, 1 - room)


def renewed(
    knowledge: SelfKnowledge, bodies: Genomes, bias: Vector, own: ActiveDiscoveryParameters
) -> SelfKnowledge:
    """The same knowledge with new samples (s,) of the body, all alike in weight, and the bias (s, 2) of each."""
    weights = np.full(len(bodies), 1 / len(bodies))
    classes = fold_classes(bodies, weights, width=math.radians(own.distinct_deg))
    first = classes[0]
    kin = np.all(bodies.parents == first.parents, axis=1)
    apart = np.abs(np.angle(np.exp(1j * (bodies.angles - first.angles))))
    near = kin & (apart.max(axis=1) <= apart[kin].max(axis=1).min() + math.radians(own.known_within_deg))
    known = np.mean(apart[kin] < math.radians(own.known_within_deg), axis=0) >= own.known_share
    return replace(
        knowledge,
        parents=first.parents,
        angles=first.angles,
        offsets=bodies.offsets[near].mean(axis=0),
        stretches=np.exp(bodies.values[near, 2 * bodies.limbs :].mean(axis=0)),
        samples=bodies,
        weights=weights,
        bias=bias,
        fold_classes=classes,
        identifiable=tuple(bool(one) for one in known),
    ).simplest(math.radians(own.simplest_deg))
