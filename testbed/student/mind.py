"""How a student thinks: the phases of its life, each by a method that the scenario names.

A mind has no body and no eyes. It asks for motor commands and is told how they tilted the body; it asks when to look
and is shown what was there. So several minds can live in one student, each judging the same candidates by the same
senses. What two of them would work out alike is worked out once.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from testbed.bodies.morphology import Vector
from testbed.student import phases
from testbed.student.body.damage import SelfCheck
from testbed.student.body.damage_report import DamageReport
from testbed.student.body.posterior import SelfKnowledge
from testbed.student.body.rediscovery import Rediscovery
from testbed.student.body.self_model import BodyPrior
from testbed.student.forms import Imitated, Modelled, Own, Self
from testbed.student.insider import Insider
from testbed.student.judging.verdict import Verdict
from testbed.student.methods import MindPlan
from testbed.student.motion import Watched
from testbed.student.parameters import ActiveDiscoveryParameters
from testbed.student.senses import Progress, Senses, silent

T = TypeVar("T")


@dataclass(frozen=True)
class Judgement:
    """What one mind made of one candidate.

    Attributes:
        looks: (frames that the mind saw,) their places among the frames of the candidate.
        model: How the teacher model came about (Section 3.3).
        imitation: How the student tried to move like it (Section 3.4); None if it did not.
        verdict: Appropriate or not.
        controller_verdict: The same by the controller alone, as in the paper; None if there is none.
    """

    looks: tuple[int, ...]
    model: Modelled
    imitation: Imitated | None
    verdict: Verdict
    controller_verdict: Verdict | None


Thought = Callable[[Progress], Judgement]
"""What is still to be thought about a candidate, telling how far it is; a pickled one can be thought elsewhere."""


class Mind:
    """One way of thinking.

    Args:
        spec: Its phases by name, and what they leave open.
        prior: What it knows of its body beforehand.
        senses: What it knows of its equipment.
        seeds: Source of all its chance.
        progress: Told how far each phase is.
        common: Thoughts of all the minds of a student, by self-discovery and by all that they depend on.
        insider: Tells baselines what no student can sense.
    """

    def __init__(
        self,
        spec: MindPlan,
        prior: BodyPrior,
        senses: Senses,
        seeds: np.random.SeedSequence,
        progress: Progress,
        common: dict[str, dict[str, object]],
        insider: Insider | None = None,
    ) -> None:
        if spec.phases.privileged != (insider is not None):
            raise ValueError("a mind is told the truth if it is a baseline that needs it, and only then")
        self._insider = insider
        self.name, self.phases, self.parameters = spec.name, spec.phases, spec.parameters
        self._prior, self._senses, self._seeds = prior, senses, seeds
        self.progress = progress
        self._self_discovery = self._key("self_discovery")
        self._common = common.setdefault(self._self_discovery, {})
        self.itself: Self | None = None

    def __getstate__(self) -> dict[str, object]:
        """For another process, where nobody shares its thoughts or hears of its progress."""
        return self.__dict__ | {"progress": silent, "_common": {}}

    def shares_with(self, other: Mind) -> bool:
        """Whether the two may work something out alike: they found their bodies in the same way."""
        return self._common is other._common

    @property
    def looks(self) -> tuple[float, ...]:
        """When it wants to see a candidate: seconds since the rig turned there."""
        looking, watching = self.parameters.looking, self.parameters.watching
        if self.phases.teacher_modelling == "eea":
            pairs = range(self.parameters.teacher_modelling.image_pairs)
            return tuple(looking.first_look + pair * looking.look_interval for pair in pairs)
        frames = range(max(2, round(watching.duration * watching.rate)))
        return tuple(looking.first_look + frame / watching.rate for frame in frames)

    def discover_itself(self) -> Generator[Vector, Vector | None, Self]:
        """Section 3.2: yields motor commands (joints,) rad and is sent the tilt (2,) rad that each led to."""
        key = self._self_discovery
        rng = np.random.default_rng(self._seeds.spawn(1)[0])
        if key not in self._common:
            discover = phases.SELF_DISCOVERY[self.phases.self_discovery]
            found = yield from discover(
                self._prior,
                self.parameters,
                self._senses,
                rng,
                self._phase("self-discovery"),
                self._insider,
            )
            self._common[key] = found
        self.itself = self._common[key]  # type: ignore[assignment]
        assert self.itself is not None
        return self.itself

    def check_itself(self) -> Generator[Vector, Vector | None, DamageReport | None]:
        """Extension: is the body still what it was? Asks and is told as :meth:`discover_itself`.

        Returns None if this mind cannot tell: it needs a posterior to know what would surprise it.
        """
        parameters = self.parameters.self_check
        if not isinstance(self.itself, SelfKnowledge) or not parameters.checks:
            return None
        check = SelfCheck(self.itself, parameters.damage, np.random.default_rng(self._seeds.spawn(1)[0]))
        for _ in range(parameters.checks):
            command = check.next_command()
            tilt = yield command
            assert tilt is not None
            if check.tell(command, tilt) is not None and parameters.anew is not None:
                return (yield from self._discover_anew(self.itself, check.record(), command, tilt))
        return check.record()

    def _discover_anew(
        self, itself: SelfKnowledge, noticed: DamageReport, command: Vector, tilt: Vector
    ) -> Generator[Vector, Vector | None, DamageReport]:
        """Extension: something is wrong, as a command (joints,) rad showed by its tilt (2,) rad. What am I now?"""
        parameters = self.parameters.self_check.anew
        assert parameters is not None
        own = self.parameters.active_discovery or ActiveDiscoveryParameters.for_limbs(len(self._prior.limbs))
        again = Rediscovery(itself, noticed, parameters, own, np.random.default_rng(self._seeds.spawn(1)[0]))
        again.tell(command, tilt)
        while again.wants_more:
            command = again.next_command()
            sensed = yield command
            assert sensed is not None
            again.tell(command, sensed)
        return again.record()

    def consider(
        self,
        number: int,
        watched: Watched,
        looks: tuple[int, ...],
        lost: DamageReport | None = None,
        *,
        bearing: float = 0.0,
        steps: tuple[int, ...] = (),
    ) -> Thought:
        """Sections 3.3 and 3.4: to model a candidate, to try to move like it, and to decide.

        Args:
            number: Which candidate.
            watched: All that the student saw of it.
            looks: Which of the frames this mind asked for.
            lost: What it found when a limb was gone: it compares the candidate with the body that is left.
            bearing: Where the candidate stands, rad; what an insider is asked about.
            steps: The action count at each frame; likewise.

        Returns:
            The thought itself: it takes long. What is left to chance in it is settled now.
        """
        assert self.itself is not None, "a mind discovers itself before it judges others"
        insider = self._insider
        shown = tuple(steps[look] for look in looks) if insider is not None else ()
        told = None if insider is None else functools.partial(insider.parts_of, bearing, shown)
        own, itself = Own(self._prior, self.itself.body, told), self._self_discovery
        if lost is not None:
            own, itself = Own(BodyPrior.of(lost.body), lost.body), f"{self.name} of what is left"
        about = f"{number} {looks} {itself}"
        return functools.partial(
            self._judge, number, about, watched.at(looks), looks, own, self._seeds.spawn(2)
        )

    def _judge(
        self,
        number: int,
        about: str,
        seen: Watched,
        looks: tuple[int, ...],
        own: Own,
        chances: Sequence[np.random.SeedSequence],
        progress: Progress,
    ) -> Judgement:
        watching, trying = map(np.random.default_rng, chances)
        parameters, body = self.parameters, own.body
        modelling = f"{about} {self._key('teacher_modelling')}"
        model = self._once(
            modelling,
            lambda: phases.TEACHER_MODELLING[self.phases.teacher_modelling](
                seen,
                own,
                self._senses,
                parameters,
                watching,
                _of(f"teacher modelling {number}", progress),
            ),
        )
        imitating = f"{modelling} {self._key('imitation')}"
        imitation = self._once(
            imitating,
            lambda: phases.IMITATION[self.phases.imitation](
                model, body, self._senses, parameters, trying, _of(f"imitation {number}", progress)
            ),
        )
        verdict = phases.VERDICT[self.phases.verdict](model, imitation, body, parameters, trying)
        by_controller: Verdict | None = None
        if imitation is not None:
            by_controller = phases.VERDICT["controller"](model, imitation, body, parameters, trying)
        return Judgement(looks, model, imitation, verdict, by_controller)

    def commands(self, judgement: Judgement, damage: DamageReport | None = None) -> Vector:
        """(steps, joints) motor commands, one a control step, with which the student moves like that teacher.

        With a joint that no longer moves it tries anew what its body still can. With a limb lost, ``judgement`` is of
        the body that is left; what is gone gets no commands.
        """
        assert self.itself is not None, "a mind discovers itself before it moves"
        body, imitation = self.itself.body, judgement.imitation
        motors: tuple[int, ...] = tuple(range(len(body.joints)))
        if damage is not None and damage.kind == "limb_lost":
            body, motors = damage.body, damage.motors
        if damage is not None and damage.kind == "joint_locked":
            body, trying = damage.body, np.random.default_rng(self._seeds.spawn(1)[0])
            imitate = phases.IMITATION[self.phases.imitation]
            again = self._phase("imitation with a damaged body")
            imitation = imitate(judgement.model, body, self._senses, self.parameters, trying, again)
        perform = phases.PERFORMANCE[self.phases.imitation]
        practising = np.random.default_rng(self._seeds.spawn(1)[0])
        steps: Vector = perform(
            judgement.model,
            imitation,
            body,
            self._senses,
            self.parameters,
            practising,
            self._phase("practising"),
        )
        commands = np.zeros((len(steps), len(self._prior.motors)))
        commands[:, motors] = steps
        return commands

    def _key(self, phase: str) -> str:
        """Everything that a phase's outcome depends on, beside what it is given."""
        method = getattr(self.phases, phase)
        sections = phases.SECTIONS[phase, method]
        return f"{method} {self.parameters.model_dump_json(include=set(sections))}"

    def _once(self, key: str, think: Callable[[], T]) -> T:
        if key not in self._common:
            self._common[key] = think()
        return self._common[key]  # type: ignore[return-value]

    def _phase(self, name: str) -> Callable[[int, int], None]:
        return _of(name, self.progress)


def _of(phase: str, progress: Progress) -> Callable[[int, int], None]:
    return lambda done, total: progress(phase, done, total)
