"""The phases of a student's life by name: a new way to do one is a short function and its name in the tables below.

=================  ============  =====================================================================================
phase              name          where it comes from
=================  ============  =====================================================================================
self-discovery     hill_climber  Section 3.2: random commands, then a hill climber over self-models
                   active        extension: many self-models, commands chosen where they disagree
                   known         baseline: told beforehand
teacher modelling  eea           Section 3.3: the estimation-exploration algorithm on pixels of three image pairs
                   joint_fit     extension: free parts of the same sizes in all frames of a motion
                   embodied      extension: the self-model itself, and bodies that it could have been
                   glance        baseline: no model, only how far away somebody is and what it looks like
                   insight       baseline: the truth
imitation          hill_climber  Section 3.4: a hill climber over the weights of the k x n network
                   rehearsed     extension: the same network, searched from several starts on a quasi-static self-model
                   none          baseline: not tried
verdict            controller    Section 3.4 and Fig. 8: how well the network imitates
                   attachment    extension: do the parts that hang together in my body stay together in theirs?
                   likelihood    extension: does my body explain what I saw better than other bodies do?
                   chance        baseline: a coin
                   nearest       baseline: the nearer, the better
                   look          baseline: does its outline look like my kind, from the side, in any posture?
=================  ============  =====================================================================================
"""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import Any

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.student import baselines
from testbed.student.body.active_discovery import ActiveDiscovery
from testbed.student.body.imagination import Imagination
from testbed.student.body.posterior import SelfKnowledge
from testbed.student.body.self_discovery import SelfDiscoveryRecord, evolve_self_model, random_commands
from testbed.student.body.self_model import BodyPrior
from testbed.student.forms import Modelled, Own, Told
from testbed.student.insider import Insider
from testbed.student.judging import likeness
from testbed.student.judging.verdict import Verdict, judge
from testbed.student.motion import Watched
from testbed.student.moving.imitation import ImitationRecord, evolve_controller
from testbed.student.moving.performing import prepare
from testbed.student.moving.rehearsal import RehearsalRecord, rehearse
from testbed.student.parameters import ActiveDiscoveryParameters, StudentParameters
from testbed.student.seeing.embodied import Embodiment, embodied
from testbed.student.seeing.joint_fit import JointFit, joint_fit
from testbed.student.seeing.teacher_modelling import Modelling, TeacherRecord
from testbed.student.senses import Senses

# Self-discovery -------------------------------------------------------------------------------------------------------


def babble(
    prior: BodyPrior,
    parameters: StudentParameters,
    senses: Senses,
    rng: np.random.Generator,
    told: Told,
    insider: Insider | None = None,
) -> Generator[Vector, Vector | None, SelfDiscoveryRecord]:
    """Section 3.2: feel how random commands tilt the body, then find the body that explains it."""
    commands = random_commands(prior, parameters.self_discovery, rng)
    tilt = np.empty((len(commands), 2))
    for number, command in enumerate(commands):
        tilt[number] = yield command
    with Imagination(parameters.imagination, senses.control_step) as imagination:
        return evolve_self_model(prior, commands, tilt, imagination, parameters.self_discovery, rng, told)


def disagree(
    prior: BodyPrior,
    parameters: StudentParameters,
    senses: Senses,
    rng: np.random.Generator,
    told: Told,
    insider: Insider | None = None,
) -> Generator[Vector, Vector | None, SelfKnowledge]:
    """Extension: try what many self-models disagree about most, and keep those that were right."""
    own = parameters.active_discovery or ActiveDiscoveryParameters.for_limbs(len(prior.limbs))
    discovery = ActiveDiscovery(prior, own, rng)
    done, total = 0, own.commands
    while discovery.wants_more:
        command = discovery.next_command()
        tilt = yield command
        assert tilt is not None
        discovery.tell(command, tilt)
        done += 1
        told(done, total)
    return discovery.record().simplest(math.radians(own.simplest_deg))


# Teacher modelling ----------------------------------------------------------------------------------------------------


def estimate_and_explore(
    watched: Watched,
    own: Own,
    senses: Senses,
    parameters: StudentParameters,
    rng: np.random.Generator,
    told: Told,
) -> TeacherRecord:
    """Section 3.3: a thousand passes on each image pair."""
    modelling = Modelling(senses.rig, own.prior.part_count, parameters.teacher_modelling, rng)
    for number, (left, right) in enumerate(watched.frames):
        modelling.observe(left, right)
        told(number + 1, len(watched.frames))
    return modelling.record(watched.times)


def fit_free_parts(
    watched: Watched,
    own: Own,
    senses: Senses,
    parameters: StudentParameters,
    rng: np.random.Generator,
    told: Told,
) -> JointFit:
    """Extension: the student's own parts, tied to nothing, in all frames at once."""
    parts = (own.prior.main, *own.prior.limbs)
    seen = joint_fit(watched, senses.rig, parts, parameters.joint_fit)
    told(1, 1)
    return seen


def embody(
    watched: Watched,
    own: Own,
    senses: Senses,
    parameters: StudentParameters,
    rng: np.random.Generator,
    told: Told,
) -> Embodiment:
    """Extension: the own body in their place, and bodies that it could have been."""
    return embodied(
        watched,
        senses.rig,
        own.body,
        parameters.embodied,
        progress=lambda share: told(round(100 * share), 100),
    )


# Imitation ------------------------------------------------------------------------------------------------------------


def climb(
    model: Modelled,
    body: Morphology,
    senses: Senses,
    parameters: StudentParameters,
    rng: np.random.Generator,
    told: Told,
) -> Any:
    """Section 3.4: a hill climber over the network's weights, the self-model physically simulated."""
    with Imagination(parameters.imagination, senses.control_step) as imagination:
        history = model.motion.sampled(parameters.imitation.samples)
        return evolve_controller(body, history, imagination, parameters.imitation, rng, told)


def try_out(
    model: Modelled,
    body: Morphology,
    senses: Senses,
    parameters: StudentParameters,
    rng: np.random.Generator,
    told: Told,
) -> RehearsalRecord:
    """Extension: the same network, searched from several starts on a quasi-static self-model."""
    with Imagination(parameters.imagination, senses.control_step) as imagination:
        return rehearse(
            body,
            model.motion.thinned(parameters.imitation.samples),
            imagination,
            parameters.rehearsal,
            rng,
            told,
            control_step=senses.control_step,
            explained=getattr(model, "explained", 1.0),
            main_known=not isinstance(model, TeacherRecord),
        )


# Performing -----------------------------------------------------------------------------------------------------------


def play_once(
    model: Modelled,
    imitation: ImitationRecord,
    body: Morphology,
    senses: Senses,
    parameters: StudentParameters,
    rng: np.random.Generator,
    told: Told,
) -> Vector:
    """Section 3.4.1 and Fig. 9: the evolved controller's commands, one a control step."""
    return imitation.commands


def play_on(
    model: Modelled,
    imitation: RehearsalRecord,
    body: Morphology,
    senses: Senses,
    parameters: StudentParameters,
    rng: np.random.Generator,
    told: Told,
) -> Vector:
    """Extension: practised first in the imagination, then for several periods of the teacher's rhythm."""
    step, own = senses.control_step, parameters.performing
    with Imagination(parameters.imagination, step) as imagination:
        ready = prepare(imitation, model.motion, body, imagination, step, own, rng, told)
    return ready.performance(step, own)


# Verdict --------------------------------------------------------------------------------------------------------------


def by_controller(
    model: Any,
    imitation: Any,
    body: Morphology,
    parameters: StudentParameters,
    rng: np.random.Generator,
) -> Verdict:
    """Section 3.4 and Fig. 8: appropriate is whose motion the evolved controller reproduces."""
    if isinstance(imitation, RehearsalRecord):
        return likeness.by_fit(imitation, parameters.likeness)
    return judge(imitation.errors, imitation.teacher_rolls.size, parameters.verdict)


def by_attachment(
    model: Any,
    imitation: Any,
    body: Morphology,
    parameters: StudentParameters,
    rng: np.random.Generator,
) -> Verdict:
    """Extension: appropriate is whose free parts hang together the way the student's do."""
    return likeness.by_attachment(model.motion, getattr(model, "explained", 0.0), body, parameters.likeness)


def by_likelihood(
    model: Any,
    imitation: Any,
    body: Morphology,
    parameters: StudentParameters,
    rng: np.random.Generator,
) -> Verdict:
    """Extension: appropriate is whom the student's own body explains better than other bodies do."""
    return likeness.by_likelihood(model, parameters.likeness)


SELF_DISCOVERY: dict[str, Any] = {"hill_climber": babble, "active": disagree, "known": baselines.ask}
TEACHER_MODELLING: dict[str, Any] = {
    "eea": estimate_and_explore,
    "joint_fit": fit_free_parts,
    "embodied": embody,
    "glance": baselines.look_once,
    "insight": baselines.be_told,
}
IMITATION: dict[str, Any] = {"hill_climber": climb, "rehearsed": try_out, "none": baselines.not_tried}
PERFORMANCE: dict[str, Any] = {"hill_climber": play_once, "rehearsed": play_on, "none": baselines.stay}
VERDICT: dict[str, Any] = {
    "controller": by_controller,
    "attachment": by_attachment,
    "likelihood": by_likelihood,
    "chance": baselines.by_chance,
    "nearest": baselines.by_distance,
    "look": baselines.by_look,
}

SECTIONS = {
    ("self_discovery", "hill_climber"): ("self_discovery", "imagination"),
    ("self_discovery", "active"): ("active_discovery", "self_discovery"),
    ("self_discovery", "known"): (),
    ("teacher_modelling", "eea"): ("teacher_modelling",),
    ("teacher_modelling", "joint_fit"): ("joint_fit",),
    ("teacher_modelling", "embodied"): ("embodied",),
    ("teacher_modelling", "glance"): ("glance",),
    ("teacher_modelling", "insight"): (),
    ("imitation", "hill_climber"): ("imitation", "imagination"),
    ("imitation", "rehearsed"): ("rehearsal", "imagination"),
    ("imitation", "none"): (),
}
"""Which of a student's parameters each method reads."""
