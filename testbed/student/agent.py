"""The student: an agent that discovers itself, looks for somebody like itself, and imitates it.

It meets the world through observations and actions alone. Its life is a generator that yields actions and receives
observations, so that it can be read from top to bottom. How it thinks is up to its mind; other minds may live in it
beside, who judge the same candidates by what it sees. The first one leads; nobody waits for the others but at the end.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Vector
from testbed.student.body.damage_report import DamageReport
from testbed.student.body.self_model import BodyPrior
from testbed.student.candidates import Candidate, Sight, choose
from testbed.student.forms import Self
from testbed.student.insider import Insider
from testbed.student.methods import MindPlan
from testbed.student.mind import Judgement, Mind
from testbed.student.minds import Elsewhere, Looks, Minds, Outcome
from testbed.student.motion import Watched
from testbed.student.senses import Acting, Observation, Progress, Senses, silent
from testbed.vision.foreground import find_candidates

T = TypeVar("T")


@dataclass(frozen=True)
class Life:
    """Everything that the student can tell afterwards.

    Attributes:
        leader: The mind that decided.
        selves: How each mind found its body, by name.
        candidates: Whom it found, from left to right.
        damage: What it found when it checked its body before it moved; None if it did not.
        again: With a limb lost, what the leader makes of the candidates with the body that is left.
        chosen: Which candidate it imitated; None if nobody was like it.
        perform_start: Its action count when it began to imitate.
        perform_steps: For how many actions it imitated.
    """

    leader: str
    selves: Mapping[str, Self]
    candidates: tuple[Candidate, ...]
    damage: DamageReport | None
    again: tuple[Judgement, ...]
    chosen: int | None
    perform_start: int
    perform_steps: int


class Student:
    """One body, one pair of eyes, one or several minds.

    Args:
        prior: What it knows of its body beforehand.
        senses: What it knows of its equipment.
        minds: How it thinks; the first one leads.
        seeds: Source of all its chance.
        progress: Told how far each phase is.
        insider: Tells baselines among the minds what no student can sense; nobody else is told.
        elsewhere: Where minds beside the leader may think of candidates; here if not given.
    """

    def __init__(
        self,
        prior: BodyPrior,
        senses: Senses,
        minds: Sequence[MindPlan],
        seeds: np.random.SeedSequence,
        progress: Progress = silent,
        insider: Insider | None = None,
        elsewhere: Elsewhere | None = None,
    ) -> None:
        self._prior, self._senses, self._progress = prior, senses, progress
        self._minds = Minds(prior, senses, minds, seeds, progress, insider, elsewhere)
        self._joints, self._pan = np.zeros(len(prior.motors)), 0.0
        self._sight = Sight(senses.rig, self._minds.leader.parameters.looking.dark_below)
        self._steps = 0
        # Between two looks that are not one watching, a whole frame passes.
        self._blinks = senses.frame_time <= self._minds.leader.parameters.looking.dwell_time
        self.looking = True  # at the images that come next
        self._acting: Generator[NDArray[np.float32], Observation, Life] | None = None
        self.life: Life | None = None

    @property
    def done(self) -> bool:
        """Whether it has lived its life."""
        return self.life is not None

    def act(self, observation: Observation) -> NDArray[np.float32]:
        """The next action: joint targets (rad) and the pan of the rig (rad). At rest when done."""
        self._steps += 1
        if self.done:
            return self._action()
        try:
            if self._acting is None:
                self._acting = self._live(observation)
                return next(self._acting)
            return self._acting.send(observation)
        except StopIteration as end:
            self.life = end.value
            return self._action()

    def _live(self, first: Observation) -> Generator[NDArray[np.float32], Observation, Life]:
        leader = self._minds.leader
        yield from self._look_aside(leader, first)
        selves = {}
        for mind in self._minds:
            selves[mind.name] = yield from self._try(mind, mind.discover_itself())

        candidates: list[Candidate] = []
        outcomes: list[dict[str, Outcome]] = []
        bearings = yield from self._look_around(leader)
        for bearing in bearings:
            others = [other for other in bearings if other != bearing]
            for seen, looks in (yield from self._tell_apart(bearing, others)):
                outcomes.append(self._minds.consider(len(candidates), seen, looks))
                judgement = outcomes[-1].pop(leader.name)()
                candidates.append(seen.judged({leader.name: judgement}, self._sight.parameters))

        judged = [candidate.judgements[leader.name] for candidate in candidates]
        damage = yield from self._try(leader, leader.check_itself())
        again: list[Judgement] = []
        if damage is not None and damage.kind == "limb_lost":
            judged = again = self._judge_again(leader, candidates, damage)
        chosen = choose(judged)
        start, steps_done = self._steps, 0
        if chosen is not None:
            commands = leader.commands(judged[chosen], damage)
            start = self._steps
            steps_done = yield from self._perform(commands)
        for number, beside in enumerate(outcomes):
            judgements = {name: outcome() for name, outcome in beside.items()}
            candidates[number] = candidates[number].judged(judgements, self._sight.parameters)
        return Life(leader.name, selves, tuple(candidates), damage, tuple(again), chosen, start, steps_done)

    def _judge_again(
        self, mind: Mind, candidates: Sequence[Candidate], lost: DamageReport
    ) -> list[Judgement]:
        """With a limb lost it is somebody else: nobody here may be like it any more, or somebody who was not."""
        if not lost.motors:
            return []  # nothing is left to move
        return [
            mind.consider(number, candidate.watched, candidate.judgements[mind.name].looks, lost)(
                mind.progress
            )
            for number, candidate in enumerate(candidates)
        ]

    def _try(
        self, mind: Mind, asking: Generator[Vector, Vector | None, T]
    ) -> Generator[NDArray[np.float32], Observation, T]:
        """Section 3.2: try the commands that the mind asks for, each from lying flat, and tell it the tilt."""
        settle = mind.parameters.self_discovery.settle_time
        rest, felt = np.zeros(len(self._prior.motors)), None
        while True:
            try:
                command = asking.send(felt)
            except StopIteration as end:
                answer: T = end.value
                break
            yield from self._hold(rest, settle)
            sensed = yield from self._hold(command, settle)
            felt = np.asarray(sensed["tilt"], dtype=float)
        if felt is not None:
            yield from self._hold(rest, settle)
        return answer

    def _look_around(self, mind: Mind) -> Generator[NDArray[np.float32], Observation, list[float]]:
        """Sweep the rig from left to right and note where something stands out from the light background."""
        looking, limit = mind.parameters.looking, self._senses.pan_limit
        stops = max(2, math.ceil(2 * limit / (looking.sweep_step * self._senses.rig.field_of_view)) + 1)
        views = []
        for pan in np.linspace(-limit, limit, stops):
            seen = yield from self._turn(float(pan), looking.dwell_time)
            views += [(float(pan), seen[eye]) for eye in ("left", "right")]
        return find_candidates(
            views,
            self._senses.rig,
            dark_below=looking.dark_below,
            gap=math.radians(looking.gap_deg),
            narrowest=math.radians(looking.narrowest_deg),
        )

    def _look_aside(self, mind: Mind, seen: Observation) -> Generator[NDArray[np.float32], Observation, None]:
        """Whoever is looked at performs and walks off: while the student is busy with itself it looks at nobody."""
        for pan in (-self._senses.pan_limit, self._senses.pan_limit):
            if self._sight.somebody_ahead(seen):
                seen = yield from self._turn(pan, mind.parameters.looking.dwell_time)

    def _tell_apart(
        self, bearing: float, others: Sequence[float]
    ) -> Generator[NDArray[np.float32], Observation, list[tuple[Candidate, Looks]]]:
        """Watch what stands in a direction; if it is two bodies at two distances, then each of them.

        The paper takes an outline for one candidate, and so does a mind that models by its ``eea``.
        """
        seen, looks = yield from self._watch(bearing, others)
        if self._minds.leader.phases.teacher_modelling == "eea":
            return [(seen, looks)]
        seen, bodies = self._sight.parted(seen)
        found, limit = [], self._senses.pan_limit
        for body in bodies:
            there = min(max(math.remainder(bearing + body.offset, math.tau), -limit), limit)
            both, looks = yield from self._watch(there, others)
            found.append((self._sight.only(both, body), looks))
        return found or [(seen, looks)]

    def _watch(
        self, bearing: float, others: Sequence[float]
    ) -> Generator[NDArray[np.float32], Observation, tuple[Candidate, Looks]]:
        """Section 3.3: turn to a candidate and take the frames that the minds ask for; the others are left out.

        Returns what was seen, and which of the frames each mind asked for.
        """
        step = self._senses.control_step
        turning = abs(bearing - self._pan) / self._senses.pan_speed
        self._pan = bearing
        wanted = {
            mind.name: [max(1, round((turning + look) / step)) for look in mind.looks] for mind in self._minds
        }
        due = sorted({look for looks in wanted.values() for look in looks})
        frames, steps = [], []
        for now, look in zip([0, *due], due, strict=False):
            seen = yield from self._wait(look - now, look=True)
            frames.append((seen["left"], seen["right"]))
            steps.append(self._steps)
        watched = Watched(np.array(frames), np.array(due) * step - turning)
        looks = {name: tuple(due.index(look) for look in looks) for name, looks in wanted.items()}
        return self._sight.alone(Candidate(bearing, tuple(steps), watched, {}), others), looks

    def _perform(self, commands: Vector) -> Generator[NDArray[np.float32], Observation, int]:
        """The evolved controller drives the student itself, one command a control step."""
        for step, command in enumerate(commands):
            self._joints = command
            yield from self._wait(1)
            self._progress("performing", step + 1, len(commands))
        return len(commands)

    def _hold(self, joints: Vector, seconds: float) -> Acting:
        """Keep a posture for a while; returns what is sensed at the end of it."""
        self._joints = joints
        return (yield from self._wait(max(1, round(seconds / self._senses.control_step))))

    def _turn(self, pan: float, seconds: float) -> Acting:
        """Turn the rig and, once there, keep it for a while; returns what is sensed at the end of it."""
        turning = abs(pan - self._pan) / self._senses.pan_speed
        self._pan = pan
        steps = max(1, round((turning + seconds) / self._senses.control_step))
        return (yield from self._wait(steps, look=True))

    def _wait(self, steps: int, *, look: bool = False) -> Acting:
        """Let control steps pass, with or without looking; returns what is sensed at the end of them."""
        self.looking = look or not self._blinks
        sensed: Observation = {}
        for _ in range(steps):
            sensed = yield self._action()
        return sensed

    def _action(self) -> NDArray[np.float32]:
        return np.append(self._joints, self._pan).astype(np.float32)
