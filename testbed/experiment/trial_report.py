"""What a trial leaves behind: rows, and arrays by name.

Arrays (T is a teacher such as ``teacher_0``; k parts, F frames, P passes, I iterations, N samples):

=============================  ==============  ==================================================================
``self/parents``               (i+1, l)        on what each of l limbs hangs in the best self-model after each
                                               iteration or command: 0 the main body, j + 1 limb j
``self/angles``                (i+1, l)        its mounting angles, rad
``self/error``                 (i+1,)          Eq. 1 of it, rad
``self/objective``             (i+1,)          m, see :func:`~testbed.experiment.truth.self_model_error`
``self/commands``, ``tilt``    (n, l), (n, 2)  rad, as commanded and as felt
``self/words``                 (sentences,)    ``active``: what it knows of its body, and what not
``self/words_since``           (sentences,)    what it came to think when it checked its body before it moved
``self/believed_tilt``         (i+1, n, 2)     rad; hill climber only
``self/truth_parents``         (l,)            the true body in the same terms
``self/truth_angles``          (l,)
``T/candidate_bearing``        ()              rad, where the student saw it
``T/look_steps``               (F,)            the student's action count at each frame of ``images``
``T/images``                   (F, 2, 75, 100) luminosity
``T/truth_parts``              (F, n, 8)       the true parts at each look, rig frame
``T/teacher_rolls``            (N, k)          rad, as fed to the network
``T/self_rolls``               (3, N, k)       rad, the self-model's at the start, the middle and the end
``T/order``                    (k,)            the object that corresponds to each part of the student
``T/controller_weights``       (I+1, n, k)     the best network after each iteration
``T/controller_error``         (I+1,)          Eq. 5, rad
``perform/start_step``         ()              action count when the student began to imitate
``perform/steps``              ()              for how many actions it imitated; 0 if nobody was like it
``perform/path``               (steps+1, 3)    m, the student's main body
``truth/A/base``, ``joints``   (t, 7), (t, n)  every agent's state at the start and after each step: m, quaternion; rad
``truth/pan``                  (t,)            where the rig really looked, rad
``truth/student/actions``      (t-1, n+1)      what the student did: joint targets and the pan, rad
``time/control_step``          ()              s
``time/exposed``               (t,)            index of the state that the newest stereo pair shows
``time/put_back``              (k,)            only of a trial that was resumed: the states after which everybody was
                                               carried back to their places
=============================  ==============  ==================================================================

A mind that models by the paper's ``eea`` adds

=============================  ==============  ==================================================================
``T/model_history``            (P+1, k, 8)     the best model at random start and after each pass, Eq. 2
``T/model_error``              (P, 2)          Eq. 4 of both models
``T/pixels``                   (P, 2, 2)       pixel (u, v) learnt by the left and by the right camera
``T/model_position_error``     (P+1,)          m, objective
``T/model_roll_error``         (P+1,)          rad, objective
``T/model_overlap``            (P+1,)          objective, see :func:`~testbed.experiment.truth.overlap`
``T/controller_objective``     (I+1,)          rms rad, see :func:`~testbed.experiment.truth.controller_error`
=============================  ==============  ==================================================================

one that models a whole motion

=============================  ==============  ==================================================================
``T/motion_times``             (F,)            s
``T/motion_parts``             (F, k, 8)       the objects in every frame, Eq. 2
``T/motion_position_error``    (F,)            m, objective
``T/motion_roll_error``        (F, k)          rad, objective, of each object; NaN where the teacher has other parts
``T/imitated_roll_error``      (F, k)          the same with objects assigned to parts as imitation did, not as the
                                               truth does
``T/explanation_parts_<j>``    (8, m, 8)       ``embodied``: the parts in the kept images by its own body (j = 0) and
                                               by the best other body (j = 1)
``T/explained``                (2,)            how much of what it saw each of the two explains, at most 1
``T/explanation_words``        (2,)            how they differ from the own body
``T/evidence``                 (bodies,)       log likelihood of every body that was compared, the own first
``T/evidence_names``           (bodies,)       what they are called
=============================  ==============  ==================================================================

On a real bench, where nobody knows the truth, ``base``, ``joints``, ``truth_parts`` and ``path`` are missing and errors
that would be measured by it are NaN, None in rows. ``path`` is missing, too, where the trial was broken off while the
student imitated: in between it was carried back.

Of minds beside the leader the same arrays are under ``beside/<name>/``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from testbed.bodies.morphology import Morphology
from testbed.experiment import truth
from testbed.experiment.performance import performance_row
from testbed.experiment.record import Row, TrialResult
from testbed.experiment.self_report import damage_row, self_arrays, self_row
from testbed.experiment.teacher_report import OF_A_FOUND_TEACHER, candidate_arrays, candidate_row
from testbed.scenario import Scenario, TeacherSpec
from testbed.student.agent import Life
from testbed.student.candidates import Candidate
from testbed.world.placement import STUDENT, teacher_names

Arrays = dict[str, NDArray[Any]]

_MISSED_BY = math.radians(20)
"""A candidate seen further than this from any teacher is nobody's."""

_DEPTH = math.radians(20)
"""How much it counts, per e-fold, that a candidate of known distance is not where a teacher stood."""


def report_trial(
    scenario: Scenario,
    trial: int,
    cell: str,
    bodies: Mapping[str, Morphology],
    life: Life,
    log: Arrays,
) -> TrialResult:
    """Hold what the student believed against what was true.

    Args:
        scenario: The trial's own scenario, nothing left to chance.
        trial: Which trial.
        cell: Of which cell.
        bodies: Everybody's true body at the beginning, by agent.
        life: What the student believed.
        log: The truth about everybody at the start and after each step.
    """
    seen = match(life.candidates, scenario)
    arrays, rows = {**log, **_perform_arrays(life, log)}, []
    for mind in scenario.minds:
        prefix = "" if mind.name == life.leader else f"beside/{mind.name}/"
        names: Row = {"trial": trial, "cell": cell, "student": mind.name}
        itself = life.selves[mind.name]
        theirs = self_arrays(itself, scenario.student.body(), bodies[STUDENT])
        arrays |= {f"{prefix}self/{key}": value for key, value in theirs.items()}
        damage = life.damage if mind.name == life.leader else None
        broke = damage_row(damage, scenario, bodies[STUDENT], log[f"truth/{STUDENT}/joints"])
        rows.append({"kind": "self", **names, **self_row(itself, scenario, bodies[STUDENT]), **broke})
        if damage is not None:
            arrays["self/words_since"] = np.array(damage.words)
        selves: Row = {
            "self_error_initial": float(theirs["objective"][0]),
            "self_error_final": float(theirs["objective"][-1]),
        }
        for index, name in enumerate(teacher_names(scenario)):
            row: Row = {
                "kind": "verdict",
                **names,
                "teacher": name,
                "robot": bodies[name].name,
                "truth": _truth(scenario, index, bodies),
                "verdict": "inappropriate",
                "score": None,
                "score_low": None,
                "score_high": None,
                "verdict_since": None,
                "found": name in seen,
                "chosen": False,
                **_staging(scenario, index),
                **selves,
                **dict.fromkeys(OF_A_FOUND_TEACHER),
            }
            if name in seen:
                candidate = life.candidates[seen[name]]
                judgement = candidate.judgements[mind.name]
                made = candidate_arrays(candidate, judgement, bodies[name], scenario, log, name)
                arrays |= {f"{prefix}{name}/{key}": value for key, value in made.items()}
                row |= candidate_row(judgement, made)
                row |= {name: getattr(candidate, name) for name in ("crowded", "hidden", "several")}
                if mind.name == life.leader and life.again:  # with the body that it has left
                    row["verdict_since"] = life.again[seen[name]].verdict.answer
                if mind.name == life.leader and life.chosen == seen[name]:
                    row["chosen"] = True
                    row |= performance_row(arrays, name, log, bodies)
            rows.append(row)
    return TrialResult(tuple(rows), _known(arrays))


def _known(arrays: Arrays) -> Arrays:
    """What is left where nobody knows the truth, as on a real bench, or there is no one path."""
    untold: tuple[str, ...] = ()
    if np.isnan(arrays[f"truth/{STUDENT}/base"]).any():
        untold = ("/base", "/joints", "/truth_parts", "perform/path")
    elif np.isnan(arrays["perform/path"]).any():
        untold = ("perform/path",)
    return {name: array for name, array in arrays.items() if not name.endswith(untold)}


def match(candidates: tuple[Candidate, ...], scenario: Scenario) -> dict[str, int]:
    """Which candidate is which teacher, one to one: together the bearings differ least, and no pair by much.

    Of those that were told apart by their distances in the same direction these count too.
    """
    gaps, depths = (
        np.array([[differ(candidate, teacher) for candidate in candidates] for teacher in scenario.teachers])
        for differ in (_bearings_differ, _distances_differ)
    )
    gaps, depths = (table.reshape(len(scenario.teachers), len(candidates)) for table in (gaps, depths))
    # However far nobody's candidates are from everybody, they must not push others out of place.
    pairs = zip(*linear_sum_assignment(np.minimum(gaps + depths, _MISSED_BY)), strict=True)
    names = teacher_names(scenario)
    return {names[teacher]: int(seen) for teacher, seen in pairs if gaps[teacher, seen] < _MISSED_BY}


def _bearings_differ(candidate: Candidate, teacher: TeacherSpec) -> float:
    return abs(math.remainder(candidate.bearing - math.radians(teacher.bearing_deg), math.tau))


def _distances_differ(candidate: Candidate, teacher: TeacherSpec) -> float:
    """In the same measure: a tenth of the way counts as some 2 degrees."""
    if candidate.distance is None:
        return 0.0
    return _DEPTH * abs(math.log(candidate.distance / float(teacher.distance)))


def _truth(scenario: Scenario, index: int, bodies: Mapping[str, Morphology]) -> str:
    told = scenario.teachers[index].appropriate
    like = told if told is not None else truth.is_like(scenario.student.body(), bodies[f"teacher_{index}"])
    return "appropriate" if like else "inappropriate"


def _staging(scenario: Scenario, index: int) -> Row:
    """Where and how a teacher was put into this trial's world."""
    teacher = scenario.teachers[index]
    return {
        "scale": float(teacher.scale),
        "distance": float(teacher.distance),
        "bearing_deg": float(teacher.bearing_deg),
        "facing_deg": float(teacher.facing_deg),
    }


def _perform_arrays(life: Life, log: Arrays) -> Arrays:
    start, steps = life.perform_start, life.perform_steps
    path = log[f"truth/{STUDENT}/base"][start - 1 : start + steps, :3] if steps else np.empty((0, 3))
    if any(start <= step + 1 < start + steps for step in log.get("time/put_back", ())):
        path = np.full_like(path, math.nan)  # it did not go this way: in between it was carried back
    return {
        "perform/start_step": np.array(start),
        "perform/steps": np.array(steps),
        "perform/path": path,
    }
