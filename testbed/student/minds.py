"""The minds of one student: who leads, what chance each has, what they share, and who may think elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from testbed.student.body.self_model import BodyPrior
from testbed.student.candidates import Candidate
from testbed.student.insider import Insider
from testbed.student.methods import MindPlan
from testbed.student.mind import Judgement, Mind, Thought
from testbed.student.senses import Progress, Senses

Looks = dict[str, tuple[int, ...]]
"""Which of the frames of a candidate each mind asked for, by the mind's name."""

Outcome = Callable[[], Judgement]
"""Waits for the end of a thought."""

Elsewhere = Callable[[Thought, Progress], Outcome]
"""Begins a thought of a mind whose progress it tells, and lets others think meanwhile."""


class Minds:
    """In the order of the scenario; the first one leads.

    Args:
        prior: What they know of their body beforehand.
        senses: What they know of their equipment.
        plans: How they think.
        seeds: Source of all their chance.
        progress: Told how far each phase is.
        insider: Tells baselines among them what no student can sense.
        elsewhere: Where those think of candidates who share no thought with others; here if not given.
    """

    def __init__(
        self,
        prior: BodyPrior,
        senses: Senses,
        plans: Sequence[MindPlan],
        seeds: np.random.SeedSequence,
        progress: Progress,
        insider: Insider | None,
        elsewhere: Elsewhere | None = None,
    ) -> None:
        common: dict[str, dict[str, object]] = {}
        self._minds = tuple(
            Mind(
                plan,
                prior,
                senses,
                own,
                _of(plan, plans, progress),
                common,
                insider if plan.phases.privileged else None,
            )
            for plan, own in zip(plans, _seeds_of_minds(seeds, len(plans)), strict=True)
        )
        self._elsewhere = elsewhere or here
        self._apart = [] if elsewhere is None else [mind for mind in self._minds if self._free(mind)]

    @property
    def leader(self) -> Mind:
        """Who decides what the student does."""
        return self._minds[0]

    def __iter__(self) -> Iterator[Mind]:
        return iter(self._minds)

    def consider(self, number: int, seen: Candidate, looks: Looks) -> dict[str, Outcome]:
        """What each mind makes of a candidate, by name; who thinks elsewhere need not be done yet."""
        outcomes = {}
        for mind in sorted(self._minds, key=lambda mind: mind not in self._apart):  # begun first, done last
            thought = mind.consider(
                number, seen.watched, looks[mind.name], bearing=seen.bearing, steps=seen.look_steps
            )
            think = self._elsewhere if mind in self._apart else here
            outcomes[mind.name] = think(thought, mind.progress)
        return outcomes

    def _free(self, mind: Mind) -> bool:
        """Nobody waits for what it thinks, as everybody does for the leader; nor does it ask or share a thought."""
        shares = any(other.shares_with(mind) for other in self._minds if other is not mind)
        return not (mind is self.leader or mind.phases.privileged or shares)


def here(thought: Thought, progress: Progress) -> Outcome:
    """Thinks at once."""
    judgement = thought(progress)
    return lambda: judgement


def _seeds_of_minds(seeds: np.random.SeedSequence, count: int) -> list[np.random.SeedSequence]:
    """The leader thinks with the student's own seeds, so that it thinks the same with or without others beside it."""
    others = [
        np.random.SeedSequence(seeds.entropy, spawn_key=(*seeds.spawn_key, _BESIDE, number))
        for number in range(count - 1)
    ]
    return [seeds, *others]


_BESIDE = 0xB51DE
"""Keeps the seeds of the minds beside the leader apart from those that it spawns itself."""


def _of(plan: MindPlan, plans: Sequence[MindPlan], progress: Progress) -> Progress:
    """Where there are several minds, progress says whose."""
    if len(plans) == 1:
        return progress
    return lambda phase, done, total: progress(f"{plan.name}: {phase}", done, total)
