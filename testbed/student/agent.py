"""The student ``paper``: an agent that discovers itself, looks for somebody like itself, and imitates it.

It meets the world through observations and actions alone. Its life is a generator that yields actions and receives
observations, so that it can be read from top to bottom.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.morphology import Vector
from testbed.student.imagination import Imagination
from testbed.student.imitation import ImitationRecord, evolve_controller
from testbed.student.parameters import PaperParameters
from testbed.student.self_discovery import SelfDiscoveryRecord, evolve_self_model, random_commands
from testbed.student.self_model import BodyPrior, self_model
from testbed.student.teacher_modelling import Modelling, TeacherRecord
from testbed.student.verdict import Verdict, judge
from testbed.vision.camera import StereoRig
from testbed.vision.foreground import find_candidates

Observation = Mapping[str, NDArray[Any]]
Acting = Generator[NDArray[np.float32], Observation, Observation]
"""Yields actions, receives observations, returns the last observation."""

Progress = Callable[[str, int, int], None]
"""Called with the phase, how much of it is done, and how much there is."""


@dataclass(frozen=True)
class Senses:
    """What the student knows of its own equipment.

    Attributes:
        rig: Its eyes.
        pan_limit: How far the rig turns to either side, rad.
        pan_speed: How fast it turns, rad/s.
        control_step: Seconds between two actions.
    """

    rig: StereoRig
    pan_limit: float
    pan_speed: float
    control_step: float


@dataclass(frozen=True)
class Candidate:
    """Somebody whom the student found, and what it made of it.

    Attributes:
        bearing: Where the student saw it, rad, positive to the right.
        look_steps: The student's action count when it took each image pair.
        model: How the teacher model came about (Section 3.3).
        imitation: How the student tried to move like it (Section 3.4).
        verdict: Appropriate or not.
    """

    bearing: float
    look_steps: tuple[int, ...]
    model: TeacherRecord
    imitation: ImitationRecord
    verdict: Verdict


@dataclass(frozen=True)
class Life:
    """Everything that the student can tell afterwards.

    Attributes:
        self_discovery: How it found its body.
        candidates: Whom it found, from left to right.
        chosen: Which candidate it imitated; None if nobody was like it.
        perform_start: Its action count when it began to imitate.
        perform_steps: For how many actions it imitated.
    """

    self_discovery: SelfDiscoveryRecord
    candidates: tuple[Candidate, ...]
    chosen: int | None
    perform_start: int
    perform_steps: int


class PaperStudent:
    """Kaipa, Bongard and Meltzoff's student (2010), to the letter.

    Args:
        prior: What it knows of its body beforehand.
        senses: What it knows of its equipment.
        parameters: What the paper leaves open.
        seeds: Source of all its chance.
        progress: Told how far each phase is.
    """

    def __init__(
        self,
        prior: BodyPrior,
        senses: Senses,
        parameters: PaperParameters,
        seeds: np.random.SeedSequence,
        progress: Progress = lambda phase, done, total: None,
    ) -> None:
        self._prior, self._senses, self._parameters, self._progress = prior, senses, parameters, progress
        self._seeds = seeds
        self._joints, self._pan = np.zeros(len(prior.motors)), 0.0
        self._steps = 0
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
                self._acting = self._live()
                return next(self._acting)
            return self._acting.send(observation)
        except StopIteration as end:
            self.life = end.value
            return self._action()

    def _live(self) -> Generator[NDArray[np.float32], Observation, Life]:
        (babbling,) = self._seeds.spawn(1)
        with Imagination(self._parameters.imagination, self._senses.control_step) as imagination:
            self_record = yield from self._discover_itself(imagination, np.random.default_rng(babbling))
            body = self_model(self._prior, self_record.genome)

            bearings = yield from self._look_around()
            candidates = []
            for number, bearing in enumerate(bearings):
                watching, trying = map(np.random.default_rng, self._seeds.spawn(2))
                model, looks = yield from self._watch(bearing, number, watching)
                imitation = evolve_controller(
                    body,
                    model.sampled(self._parameters.imitation.samples),
                    imagination,
                    self._parameters.imitation,
                    trying,
                    self._phase(f"imitation {number}"),
                )
                verdict = judge(imitation.errors, imitation.teacher_rolls.size, self._parameters.verdict)
                candidates.append(Candidate(bearing, looks, model, imitation, verdict))

        chosen = choose(candidates)
        start = self._steps
        steps = 0
        if chosen is not None:
            steps = yield from self._perform(candidates[chosen].imitation.commands)
        return Life(self_record, tuple(candidates), chosen, start, steps)

    def _discover_itself(
        self, imagination: Imagination, rng: np.random.Generator
    ) -> Generator[NDArray[np.float32], Observation, SelfDiscoveryRecord]:
        """Section 3.2: feel how random commands tilt the body, then find the body that explains it."""
        parameters = self._parameters.self_discovery
        commands, tilt = random_commands(self._prior, parameters, rng), []
        for command in commands:
            yield from self._hold(np.zeros_like(command), parameters.settle_time)
            felt = yield from self._hold(command, parameters.settle_time)
            tilt.append(np.asarray(felt["tilt"], dtype=float))
        yield from self._hold(np.zeros(len(self._prior.motors)), parameters.settle_time)
        return evolve_self_model(
            self._prior,
            commands,
            np.array(tilt),
            imagination,
            parameters,
            rng,
            self._phase("self-discovery"),
        )

    def _look_around(self) -> Generator[NDArray[np.float32], Observation, list[float]]:
        """Sweep the rig from left to right and note where something stands out from the light background."""
        looking, limit = self._parameters.looking, self._senses.pan_limit
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

    def _watch(
        self, bearing: float, number: int, rng: np.random.Generator
    ) -> Generator[NDArray[np.float32], Observation, tuple[TeacherRecord, tuple[int, ...]]]:
        """Section 3.3: model a moving candidate, a new image pair every thousand passes."""
        looking, parameters = self._parameters.looking, self._parameters.teacher_modelling
        modelling = Modelling(self._senses.rig, self._prior.part_count, parameters, rng)
        progress = self._phase(f"teacher modelling {number}")
        looks = []
        seen = yield from self._turn(bearing, looking.first_look)
        for pair in range(parameters.image_pairs):
            looks.append(self._steps)
            modelling.observe(seen["left"], seen["right"])
            progress(pair + 1, parameters.image_pairs)
            if pair + 1 < parameters.image_pairs:
                seen = yield from self._turn(bearing, looking.look_interval)
        return modelling.record(), tuple(looks)

    def _perform(self, commands: Vector) -> Generator[NDArray[np.float32], Observation, int]:
        """The evolved controller drives the student itself, one command a control step."""
        progress = self._phase("performing")
        for step, command in enumerate(commands):
            self._joints = command
            yield self._action()
            progress(step + 1, len(commands))
        return len(commands)

    def _hold(self, joints: Vector, seconds: float) -> Acting:
        """Keep a posture for a while; returns what is sensed at the end of it."""
        self._joints = joints
        sensed: Observation = {}
        for _ in range(max(1, round(seconds / self._senses.control_step))):
            sensed = yield self._action()
        return sensed

    def _turn(self, pan: float, seconds: float) -> Acting:
        """Turn the rig and, once there, keep it for a while; returns what is sensed at the end of it."""
        turning = abs(pan - self._pan) / self._senses.pan_speed
        self._pan = pan
        return (yield from self._hold(self._joints, turning + seconds))

    def _action(self) -> NDArray[np.float32]:
        return np.append(self._joints, self._pan).astype(np.float32)

    def _phase(self, name: str) -> Callable[[int, int], None]:
        return lambda done, total: self._progress(name, done, total)


def choose(candidates: list[Candidate]) -> int | None:
    """The appropriate candidate with the highest score; None if nobody is appropriate."""
    like_me = [i for i, candidate in enumerate(candidates) if candidate.verdict.answer == "appropriate"]
    return max(like_me, key=lambda i: candidates[i].verdict.score, default=None)
