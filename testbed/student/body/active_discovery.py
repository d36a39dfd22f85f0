"""Self-discovery ``active``: commands where self-models disagree, and a search that keeps several topologies alive.

An extension of Section 3.2 in the spirit of Bongard, Zykov and Lipson (2006): a population of self-models chooses the
next command, namely the one about whose outcome its members differ most; what is felt then improves the population.
Used as ask and tell, so that whoever owns the body stays in charge of it::

    discovery = ActiveDiscovery(prior, parameters, rng)
    while discovery.wants_more:
        command = discovery.next_command()
        ...lie flat, move there, wait...
        discovery.tell(command, tilt)
    knowledge = discovery.record()
"""

from __future__ import annotations

import math

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student.body.commands import worth_of
from testbed.student.body.genomes import Foresight, Genomes
from testbed.student.body.plausibility import Felt, Fit, judge_bodies
from testbed.student.body.population import spread_evenly, survivors, tempered
from testbed.student.body.posterior import FoldClass, History, SelfKnowledge, fold_classes
from testbed.student.body.posterior_samples import sample_posterior
from testbed.student.body.proposals import Proposals
from testbed.student.body.refinement import Refinement
from testbed.student.body.self_model import BodyPrior, Tree
from testbed.student.body.settling import LEVEL
from testbed.student.parameters import ActiveDiscoveryParameters


class ActiveDiscovery:
    """Ask :meth:`next_command`, do it from lying flat, :meth:`tell` what was felt; at the end, :meth:`record`.

    Args:
        prior: What the student knows of its body beforehand.
        parameters: What is open.
        rng: Source of all chance.
    """

    def __init__(
        self, prior: BodyPrior, parameters: ActiveDiscoveryParameters, rng: np.random.Generator
    ) -> None:
        self._prior, self._parameters, self._rng = prior, parameters, rng
        self.mind = Foresight(prior)
        limbs = len(prior.motors)
        self._felt = Felt(np.empty((0, limbs)), np.empty((0, 2)))
        self._proposals = Proposals(
            limbs, parameters.beliefs, rng, outward=parameters.outward, elite=parameters.elite
        )
        self._refinement = Refinement(self.mind, parameters.beliefs)
        self._people = self._proposals.from_prior(parameters.population)
        self._ups = np.empty((len(self._people), 0, 3))
        self._lying = LEVEL
        self._fit = self._judge(self._ups, self._people)
        self._history: list[History] = []

    @property
    def wants_more(self) -> bool:
        """Whether fewer commands were told than planned."""
        return len(self._felt.commands) < self._parameters.commands

    def next_command(self) -> Vector:
        """(n,) rad: of a pool of commands the one about whose outcome the likely self-models differ most."""
        parameters, limits = self._parameters, self._prior.limits
        voters, votes = self._voters()
        told, alone = len(self._felt.commands), None
        if told < len(limits) * parameters.openings:
            alone = told % len(limits)
        pool = parameters.choice.draw(limits, parameters.pool, self._rng, alone=alone)
        worth = self._worth(voters, votes, pool)
        best = pool[np.argsort(-worth)[: parameters.runners_up]]
        near = parameters.choice.near(np.repeat(best, 4, axis=0), limits, self._rng)
        worth = np.concatenate([worth, self._worth(voters, votes, near)])
        return np.asarray(np.concatenate([pool, near])[int(np.argmax(worth))])

    def _worth(self, voters: Genomes, votes: Vector, commands: Vector) -> Vector:
        parameters = self._parameters
        ups, haste = self.mind.foresee(voters, commands, starts=self._lying)
        if parameters.nudge_deg:
            nudges = self._rng.normal(0.0, math.radians(parameters.nudge_deg), commands.shape)
            again, _ = self.mind.foresee(voters, commands + nudges, starts=self._lying)
            apart = 2 * np.arcsin(np.clip(np.linalg.norm(ups - again, axis=2) / 2, 0, 1))
            haste = haste + np.where(apart > 4 * math.radians(parameters.nudge_deg), 1.0, 0.0)
        return worth_of(votes, ups, haste, parameters.beliefs.spread, parameters.choice)

    def tell(self, command: Vector, tilt: Vector) -> None:
        """Learn from the tilt (2,) rad, felt after a command (n,) rad that was given to the body lying flat."""
        command = np.asarray(command, dtype=float)
        newest = Felt(command[None], np.asarray(tilt, dtype=float)[None])
        self._felt = self._felt.with_reading(command, newest.tilt[0])
        new = self._relived(self._people, newest)
        self._ups = np.concatenate([self._ups, new], axis=1)
        self._fit = self._judge(self._ups, self._people)
        self._search(self._allowance())
        self._remember()
        if self._parameters.beliefs.in_place:
            self._lying = self._stretched_out(newest)

    def _stretched_out(self, newest: Felt) -> Vector:
        """(3,) up where the body lies flat again after a reading, as most of those who choose expect.

        A body that turned over starts the next command from its back.
        """
        voters, _ = self._voters()
        flat = np.zeros_like(newest.commands)
        ups = self.mind.foresee(voters, flat, starts=newest.up, there=True)[0][:, 0]
        return np.asarray(ups[int(np.argmax(ups @ ups.mean(axis=0)))])

    def record(self) -> SelfKnowledge:
        """What is known now; spends the evaluations that were kept for the posterior."""
        parameters, felt = self._parameters, self._felt
        log_posterior = self._fit.log_posterior
        order = [row for row in np.argsort(-log_posterior) if log_posterior[row] > log_posterior.max() - 12]
        modes = self._people.take(order[: parameters.modes])
        covariances = self._refinement.covariances(
            modes, self._ups[order[: parameters.modes]], felt, math.radians(parameters.widest_deg)
        )
        left = parameters.evaluations - self.mind.evaluations - len(modes) - 1
        count = min(max(parameters.fewest_samples, left), parameters.most_samples)
        samples, weights, heights, bias = sample_posterior(
            modes, covariances, self.mind, felt, parameters.beliefs, count, self._rng
        )
        samples, heights = (
            Genomes.joined(samples, modes),
            np.append(heights, log_posterior[order[: len(modes)]]),
        )
        weights = np.append(weights, np.zeros(len(modes)))
        bias = np.concatenate([bias, self._fit.bias[order[: len(modes)]]])
        classes = fold_classes(samples, weights, width=math.radians(parameters.distinct_deg))
        middle = self._middle(samples, weights, classes[0])
        samples, weights = Genomes.joined(samples, middle), np.append(weights, 0.0)
        fit = self._judge(self._relived(middle, felt), middle)
        heights, bias = np.append(heights, fit.log_posterior), np.concatenate([bias, fit.bias])
        best = int(np.argmax(heights))
        if heights[-1] > heights[best] - parameters.middle_within:
            best = len(heights) - 1
        near = np.abs(np.angle(np.exp(1j * (samples.angles - samples.angles[best])))) < math.radians(
            parameters.known_within_deg
        )
        kin = np.all(samples.parents == samples.parents[best], axis=1)
        sure = weights @ (near & kin[:, None]) >= parameters.known_share * (weights @ kin)
        return SelfKnowledge(
            prior=self._prior,
            parents=samples.trees[best],
            angles=samples.angles[best],
            offsets=samples.offsets[best],
            stretches=samples.stretches[best],
            samples=samples,
            weights=weights,
            bias=bias,
            fold_classes=classes,
            identifiable=tuple(bool(known) for known in sure),
            commands=felt.commands,
            tilt=felt.tilt,
            history=tuple(self._history),
            evaluations=self.mind.evaluations,
            beliefs=parameters.beliefs,
        )

    @staticmethod
    def _middle(samples: Genomes, weights: Vector, group: FoldClass) -> Genomes:
        """The mean body of a group: nearer to the truth than its likeliest member wherever the group is wide."""
        limbs = samples.limbs
        kin = np.all(samples.parents == group.parents, axis=1)
        near = np.abs(np.angle(np.exp(1j * (samples.angles - group.angles)))).max(axis=1)
        shares = weights * kin * (near <= near[kin & (weights > 0)].min() + math.radians(20.0))
        values = (samples.values[:, limbs:] * shares[:, None]).sum(axis=0) / shares.sum()
        return Genomes(
            np.array([group.parents], dtype=np.int64), np.concatenate([group.angles, values])[None]
        )

    def _remember(self) -> None:
        best = int(np.argmax(self._fit.log_posterior))
        apart = 2 * np.arcsin(np.clip(np.linalg.norm(self._ups[best] - self._felt.up, axis=1) / 2, 0, 1))
        self._history.append(
            History(
                self._people.trees[best],
                self._people.angles[best].copy(),
                float(np.sqrt(np.mean(apart**2))),
                self.mind.evaluations,
            )
        )

    def _allowance(self) -> int:
        """Evaluations to spend on the search after this command."""
        parameters = self._parameters
        left = parameters.commands - len(self._felt.commands)
        asking = (2 + 2 * bool(parameters.nudge_deg) + parameters.beliefs.in_place) * parameters.voters
        upkeep = left * (parameters.population + asking)
        free = (1 - parameters.final_share) * parameters.evaluations - self.mind.evaluations - upkeep
        told = len(self._felt.commands)
        if parameters.late:  # in proportion to what is known: later commands count more
            return max(0, int(free * told / sum(range(told, told + left + 1))))
        return max(0, int(free / (left + 1)))

    def _search(self, budget: int) -> None:
        """A share of the budget explores; the rest goes downhill from the best of every topology, in between."""
        end = self.mind.evaluations + budget
        rounds = self._parameters.rounds
        for round_ in range(rounds):
            count = int(self._parameters.exploring * budget / rounds)
            self._add(self._proposals.from_people(self._people, self._fit.log_posterior, count))
            for _ in range(self._parameters.scans):
                self._scan(end)
            self._descend(end - (rounds - 1 - round_) * budget // rounds)

    def _scan(self, end: int) -> None:
        """Hang a limb of one of the best self-models everywhere."""
        rank = min(int(self._rng.exponential(1.0)), len(self._people) - 1)
        person = self._people.take([int(np.argsort(-self._fit.log_posterior)[rank])])
        places = self._proposals.everywhere(person, int(self._rng.integers(self._people.limbs)))
        if len(places) <= end - self.mind.evaluations:
            self._add(places)

    def _descend(self, end: int) -> None:
        while self.mind.evaluations < end:
            rows = self._refinement.choose(self._people, self._fit.log_posterior, end - self.mind.evaluations)
            if not rows:
                break
            better = self._refinement.step(self._people.take(rows), self._ups[rows], self._felt, rows)
            self._replace(rows, *better)

    def _add(self, newcomers: Genomes) -> None:
        if not len(newcomers):
            return
        ups = self._relived(newcomers, self._felt)
        self._people = Genomes.joined(self._people, newcomers)
        self._ups = np.concatenate([self._ups, ups])
        self._fit = self._judge(self._ups, self._people)
        kept = survivors(self._people, self._fit.log_posterior, self._parameters)
        self._people, self._ups = self._people.take(kept), self._ups[kept]
        self._fit = self._judge(self._ups, self._people)
        self._refinement.forget(kept)

    def _replace(self, rows: list[int], people: Genomes, ups: Vector) -> None:
        self._people.values[rows] = people.values
        self._ups[rows] = ups
        self._fit = self._judge(self._ups, self._people)

    def _relived(self, people: Genomes, felt: Felt) -> Vector:
        return self.mind.relive(people, felt, self._parameters.beliefs)

    def _judge(self, ups: Vector, people: Genomes) -> Fit:
        return judge_bodies(ups, people.values, self._felt, self._parameters.beliefs)

    def _voters(self) -> tuple[Genomes, Vector]:
        """Who chooses a command, and how much each counts.

        They are the two best self-models of each of the likeliest topologies, then the best of all; each stands for
        itself, and once its own uncertainty is known, for a body drawn from it.
        """
        parameters = self._parameters
        trees, seen, first, rest = self._people.trees, dict[Tree, int](), list[int](), list[int]()
        for row in np.argsort(-self._fit.log_posterior).tolist():
            seen[trees[row]] = seen.get(trees[row], 0) + 1
            (first if seen[trees[row]] <= 2 else rest).append(row)
        half = max(2, parameters.voters * 2 // 3)
        rows = (first[:half] + rest + first[half:])[: parameters.voters]
        votes = tempered(self._fit.log_posterior[rows], parameters.voter_freedom)
        speakers = [rows[i] for i in spread_evenly(votes, parameters.voters)]
        voters = self._people.take(speakers)
        values = voters.values.copy()
        for value in values:
            covariance = self._refinement.spread_of(value, math.radians(parameters.widest_deg))
            if covariance is not None:
                value += self._rng.multivariate_normal(np.zeros(len(value)), covariance, method="eigh")
        return Genomes(voters.parents, values), np.full(len(speakers), 1 / len(speakers))
