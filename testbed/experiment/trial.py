"""One trial: a student lives among its teachers, and afterwards its beliefs are held against the truth.

Arrays of a trial, by name (T is a teacher such as ``teacher_0``; k parts, P passes, I iterations, N samples):

=============================  ==============  ==================================================================
``self/genome``                (i+1, 3)        alpha rad, lambda, beta rad; the parent after each iteration
``self/error``                 (i+1,)          Eq. 1, rad
``self/objective``             (i+1,)          m, see :func:`~testbed.experiment.truth.self_model_error`
``self/commands``, ``tilt``    (n, 2)          rad, as commanded and as felt
``self/believed_tilt``         (i+1, n, 2)     rad
``self/truth_genome``          (3,)            the true body in the same terms
``T/candidate_bearing``        ()              rad, where the student saw it
``T/look_steps``               (3,)            the student's action count at each image pair
``T/images``                   (3, 2, 75, 100) luminosity
``T/model_history``            (P+1, k, 8)     the best model at random start and after each pass, Eq. 2
``T/model_error``              (P, 2)          Eq. 4 of both models
``T/pixels``                   (P, 2, 2)       pixel (u, v) learnt by the left and by the right camera
``T/model_position_error``     (P+1,)          m, objective
``T/model_roll_error``         (P+1,)          rad, objective
``T/model_overlap``            (P+1,)          objective, see :func:`~testbed.experiment.truth.overlap`
``T/truth_parts``              (3, n, 8)       the true parts at each look, rig frame
``T/controller_weights``       (I+1, 2, k)     the parent network after each iteration
``T/controller_error``         (I+1,)          Eq. 5, rad
``T/controller_objective``     (I+1,)          rms rad, see :func:`~testbed.experiment.truth.controller_error`
``T/teacher_rolls``            (N, k)          rad, as fed to the network
``T/self_rolls``               (3, N, k)       rad, the self-model's at the start, the middle and the end
``T/order``                    (k,)            the object that corresponds to each part of the student
``perform/start_step``         ()              action count when the student began to imitate
``perform/steps``              ()              for how many actions it imitated; 0 if nobody was like it
``perform/path``               (steps+1, 3)    m, the student's main body
``truth/A/base``, ``joints``   (t, 7), (t, n)  every agent's state at the start and after each step: m, quaternion; rad
``time/control_step``          ()              s
``time/exposed``               (t,)            index of the state that the newest stereo pair shows
=============================  ==============  ==================================================================
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from testbed.experiment import truth
from testbed.experiment.record import Row, TrialResult
from testbed.morphology import Morphology, Vector
from testbed.scenario import Scenario
from testbed.student.agent import Candidate, Life, PaperStudent, Progress, Senses
from testbed.student.self_model import BodyPrior, self_model, true_genome
from testbed.vision.camera import StereoRig
from testbed.vision.primitives import OMEGA
from testbed.world.bullet import SimulatedBackend
from testbed.world.env import World
from testbed.world.gaits import scripted_policy
from testbed.world.placement import STUDENT, teacher_names

Arrays = dict[str, NDArray[Any]]

_MISSED_BY = math.radians(20)
"""A candidate seen further than this from any teacher is nobody's."""


_OF_A_FOUND_TEACHER = (
    "initial_error",
    "final_error",
    "objective_initial_error",
    "objective_final_error",
    "model_position_error_initial",
    "model_position_error_final",
    "model_roll_error_initial",
    "model_roll_error_final",
    "model_overlap_initial",
    "model_overlap_final",
    "path_length",
    "path_forward",
    "teacher_forward",
)
"""Columns that are empty for a teacher that the student did not find; the last three also for those it did not imitate.
Every row has them, so that all trials have the same columns."""


def silent(phase: str, done: int, total: int) -> None:
    """Reports no progress."""


def run_trial(scenario: Scenario, trial: int, progress: Progress = silent) -> TrialResult:
    """Let the scenario's student live among its teachers once.

    Args:
        scenario: Who is in the world.
        trial: Which trial; with the scenario's seed it decides all that is left to chance.
        progress: Told how far each phase is.
    """
    world_seed, student_seed = np.random.SeedSequence([scenario.seed, trial]).spawn(2)
    backend = SimulatedBackend(scenario)
    world = World(scenario, backend=backend)
    try:
        student = _student(scenario, backend.robots[STUDENT], student_seed, progress)
        log = live(world, backend, student, int(world_seed.generate_state(1)[0]))
    finally:
        world.close()
    assert student.life is not None
    return report_trial(scenario, trial, backend.robots, student.life, log)


def rig_of(scenario: Scenario) -> StereoRig:
    """The student's eyes."""
    rig = scenario.rig
    return StereoRig(field_of_view=math.radians(rig.field_of_view_deg), baseline=rig.baseline)


def _student(
    scenario: Scenario, body: Morphology, seeds: np.random.SeedSequence, progress: Progress
) -> PaperStudent:
    rig = scenario.rig
    senses = Senses(
        rig=rig_of(scenario),
        pan_limit=math.radians(rig.pan_limit_deg),
        pan_speed=math.radians(rig.pan_speed_deg),
        control_step=scenario.world.control_step,
    )
    return PaperStudent(BodyPrior.of(body), senses, scenario.student.parameters, seeds, progress)


def live(world: World, backend: SimulatedBackend, student: PaperStudent, seed: int) -> Arrays:
    """Everybody acts until the student is done; returns the truth about everybody at the start and after each step."""
    control_step = world.scenario.world.control_step
    policies = {
        name: scripted_policy(teacher.gait, backend.robots[name], control_step)
        for name, teacher in zip(teacher_names(world.scenario), world.scenario.teachers, strict=True)
    }
    observations, _ = world.reset(seed=seed)
    # What the student senses at its n-th action is the state with index n - 1.
    states: dict[str, list[tuple[Vector, Vector]]] = {name: [backend.state(name)] for name in backend.robots}
    exposed = [backend.exposed]
    while world.agents and not student.done:
        actions: Arrays = {name: policy.act(observations[name]) for name, policy in policies.items()}
        actions[STUDENT] = student.act(observations[STUDENT])
        observations, *_ = world.step(actions)
        for name, states_of in states.items():
            states_of.append(backend.state(name))
        exposed.append(backend.exposed)
    if not student.done:
        raise world.scenario.source.error(
            ("world", "max_cycles"),
            f"the student was not done after world.max_cycles = {world.scenario.world.max_cycles} steps",
            "give it more; with the default parameters a life takes some 3000",
        )
    log: Arrays = {"time/control_step": np.array(control_step), "time/exposed": np.array(exposed)}
    for name, states_of in states.items():
        log[f"truth/{name}/base"] = np.array([base for base, _ in states_of])
        log[f"truth/{name}/joints"] = np.array([joints for _, joints in states_of])
    return log


def report_trial(
    scenario: Scenario, trial: int, bodies: Mapping[str, Morphology], life: Life, log: Arrays
) -> TrialResult:
    """Hold what the student believed against what was true."""
    arrays = {**log, **_self_arrays(life, bodies[STUDENT]), **_perform_arrays(life, log)}
    seen = match(life.candidates, scenario)
    rows = []
    for index, name in enumerate(teacher_names(scenario)):
        row: Row = {
            "trial": trial,
            "cell": "default",
            "student": scenario.student.method,
            "teacher": name,
            "robot": bodies[name].name,
            "truth": _truth(scenario, index, bodies),
            "verdict": "inappropriate",
            "score": None,
            "score_low": None,
            "score_high": None,
            "found": name in seen,
            "chosen": False,
            "self_error_initial": float(arrays["self/objective"][0]),
            "self_error_final": float(arrays["self/objective"][-1]),
            **dict.fromkeys(_OF_A_FOUND_TEACHER),
        }
        if name in seen:
            candidate = life.candidates[seen[name]]
            theirs = _candidate_arrays(candidate, bodies[name], scenario, log, name)
            arrays.update({f"{name}/{key}": value for key, value in theirs.items()})
            row.update(_candidate_row(candidate, theirs))
            row["chosen"] = life.chosen == seen[name]
            if row["chosen"]:
                row.update(_path_row(arrays, name, log))
        rows.append(row)
    return TrialResult(tuple(rows), arrays)


def match(candidates: tuple[Candidate, ...], scenario: Scenario) -> dict[str, int]:
    """Which candidate is which teacher, one to one: together the bearings differ least, and no pair by much."""
    gaps = np.array(
        [
            [
                abs(math.remainder(candidate.bearing - math.radians(teacher.bearing_deg), math.tau))
                for candidate in candidates
            ]
            for teacher in scenario.teachers
        ]
    ).reshape(len(scenario.teachers), len(candidates))
    pairs = zip(*linear_sum_assignment(gaps), strict=True)
    names = teacher_names(scenario)
    return {names[teacher]: int(seen) for teacher, seen in pairs if gaps[teacher, seen] < _MISSED_BY}


def _truth(scenario: Scenario, index: int, bodies: Mapping[str, Morphology]) -> str:
    told = scenario.teachers[index].appropriate
    like = told if told is not None else truth.is_like(bodies[STUDENT], bodies[f"teacher_{index}"])
    return "appropriate" if like else "inappropriate"


def _self_arrays(life: Life, body: Morphology) -> Arrays:
    record, prior = life.self_discovery, BodyPrior.of(body)
    return {
        "self/genome": record.genomes,
        "self/error": record.errors,
        "self/objective": np.array(
            [truth.self_model_error(self_model(prior, genome), body) for genome in record.genomes]
        ),
        "self/commands": record.commands,
        "self/tilt": record.tilt,
        "self/believed_tilt": record.believed_tilt,
        "self/truth_genome": true_genome(body),
    }


def _perform_arrays(life: Life, log: Arrays) -> Arrays:
    start, steps = life.perform_start, life.perform_steps
    path = log[f"truth/{STUDENT}/base"][start - 1 : start + steps, :3] if steps else np.empty((0, 3))
    return {
        "perform/start_step": np.array(start),
        "perform/steps": np.array(steps),
        "perform/path": path,
    }


def _candidate_arrays(
    candidate: Candidate, body: Morphology, scenario: Scenario, log: Arrays, name: str
) -> Arrays:
    model, imitation = candidate.model, candidate.imitation
    passes, looks = len(model.error), len(candidate.look_steps)
    after_each_pass = model.history[len(model.history) // passes - 1 :: len(model.history) // passes]
    beliefs = np.concatenate([model.initial[None], after_each_pass])
    base, joints = log[f"truth/{name}/base"], log[f"truth/{name}/joints"]
    true_parts = np.array(
        [
            truth.parts_in_view(
                body, base[shown], joints[shown], eye_height=scenario.rig.height, pan=candidate.bearing
            )
            for shown in log["time/exposed"][np.array(candidate.look_steps) - 1]
        ]
    )
    true_then = [true_parts[max(number - 1, 0) * looks // passes] for number in range(passes + 1)]
    pairs = list(zip(beliefs, true_then, strict=True))
    errors = np.array([truth.teacher_model_error(parts, true) for parts, true in pairs])
    rig = rig_of(scenario)
    middle = len(imitation.errors) // 2
    return {
        "candidate_bearing": np.array(candidate.bearing),
        "look_steps": np.array(candidate.look_steps),
        "images": model.images,
        "model_history": beliefs,
        "model_error": model.error,
        "pixels": model.pixels,
        "model_position_error": errors[:, 0],
        "model_roll_error": errors[:, 1],
        "model_overlap": np.array([truth.overlap(parts, true, rig) for parts, true in pairs]),
        "truth_parts": true_parts,
        "controller_weights": imitation.weights,
        "controller_error": imitation.errors,
        "controller_objective": _controller_objective(candidate, body, true_parts),
        "teacher_rolls": imitation.teacher_rolls,
        "self_rolls": np.stack([imitation.responses[i] for i in (0, middle, -1)]),
        "order": imitation.order,
    }


def _controller_objective(candidate: Candidate, body: Morphology, true_parts: Vector) -> Vector:
    imitation = candidate.imitation
    names = list(body.parts)
    in_motor_order = [names.index(body.root), *(names.index(j.child) for j in body.joints.values())]
    true_rolls = true_parts[..., OMEGA][:, in_motor_order]
    if true_rolls.shape[1] != imitation.teacher_rolls.shape[1]:
        return np.full(len(imitation.errors), np.nan)  # other parts than the student's: nothing to compare
    objective = np.empty(len(imitation.errors))
    for index, response in enumerate(imitation.responses):
        same = index > 0 and response is imitation.responses[index - 1]
        objective[index] = objective[index - 1] if same else truth.controller_error(response, true_rolls)
    return objective


def _candidate_row(candidate: Candidate, arrays: Arrays) -> Row:
    def ends(key: str) -> tuple[float | None, float | None]:
        first, last = float(arrays[key][0]), float(arrays[key][-1])
        return (first if math.isfinite(first) else None), (last if math.isfinite(last) else None)

    row: Row = {"verdict": candidate.verdict.answer, "score": candidate.verdict.score}
    row["initial_error"], row["final_error"] = ends("controller_error")
    row["objective_initial_error"], row["objective_final_error"] = ends("controller_objective")
    row["model_position_error_initial"], row["model_position_error_final"] = ends("model_position_error")
    row["model_roll_error_initial"], row["model_roll_error_final"] = ends("model_roll_error")
    row["model_overlap_initial"], row["model_overlap_final"] = ends("model_overlap")
    return row


def _path_row(arrays: Arrays, name: str, log: Arrays) -> Row:
    """How far the imitating student came, and its teacher between the first and the last look."""
    path = arrays["perform/path"][:, :2]
    start = log[f"truth/{STUDENT}/base"][int(arrays["perform/start_step"]) - 1]
    ahead = Rotation.from_quat(start[3:]).apply([1.0, 0.0, 0.0])[:2]
    looks = arrays[f"{name}/look_steps"]
    teacher = log[f"truth/{name}/base"][[looks[0] - 1, looks[-1] - 1], :2]
    return {
        "path_length": float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
        "path_forward": float((path[-1] - path[0]) @ ahead / np.linalg.norm(ahead)),
        "teacher_forward": float(np.linalg.norm(teacher[1] - teacher[0])),
    }
