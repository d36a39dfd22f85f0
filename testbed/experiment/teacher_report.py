"""What each mind made of a teacher, held against the truth."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from testbed.bodies.morphology import Morphology, Vector
from testbed.experiment import performance, truth
from testbed.experiment.record import Row
from testbed.scenario import Scenario
from testbed.student.candidates import Candidate
from testbed.student.forms import Modelled
from testbed.student.mind import Judgement
from testbed.student.moving.rolls import read_rolls
from testbed.student.seeing.embodied import Embodiment
from testbed.student.seeing.glance import Glance
from testbed.student.seeing.joint_fit import JointFit
from testbed.student.seeing.teacher_modelling import TeacherRecord
from testbed.vision.camera import StereoRig
from testbed.vision.primitives import OMEGA, X, Z

Arrays = dict[str, NDArray[Any]]

KEPT_IMAGES = 8
"""Of the frames of a whole motion so many, evenly spread, are kept as pictures."""

IN_PLACE = math.radians(15)
"""A part whose roll is off by less than this is right."""

_ERRORS = {
    "error": "controller_error",
    "objective_error": "controller_objective",
    "model_position_error": "model_position_error",
    "model_roll_error": "model_roll_error",
    "model_overlap": "model_overlap",
}
"""Columns ``<name>_initial`` and ``<name>_final`` by the array that they are the ends of."""


def _ends_of(name: str) -> tuple[str, str]:
    if name.endswith("error") and not name.startswith("model"):
        stem = name.removesuffix("error")
        return f"{stem}initial_error", f"{stem}final_error"
    return f"{name}_initial", f"{name}_final"


OF_A_FOUND_TEACHER = (
    "crowded",
    "hidden",
    "several",
    "probability",
    "reason",
    "controller_verdict",
    "controller_score",
    "controller_probability",
    *(column for name in _ERRORS for column in _ends_of(name)),
    "motion_roll_error_median_deg",
    "motion_roll_error_worst_deg",
    "parts_in_place",
    "imitated_roll_error_median_deg",
    "explained",
    "best_other",
    "explained_by_other",
    "unexplained",
    "left_over",
    *performance.COLUMNS,
)
"""Columns that are empty for a teacher that the student did not find, or that its mind knows nothing about. Every row
has them, so that all trials have the same columns."""


def candidate_arrays(
    candidate: Candidate,
    judgement: Judgement,
    body: Morphology,
    scenario: Scenario,
    log: Arrays,
    name: str,
) -> Arrays:
    """How a mind modelled and imitated one teacher; see :mod:`testbed.experiment.trial_report`."""
    steps = np.array(candidate.look_steps)[list(judgement.looks)]
    base, joints = log[f"truth/{name}/base"], log[f"truth/{name}/joints"]
    true_parts = np.array(
        [
            truth.parts_in_view(
                body, base[shown], joints[shown], eye_height=scenario.rig.height, pan=log["truth/pan"][shown]
            )
            for shown in log["time/exposed"][steps - 1]
        ]
    )
    arrays: Arrays = {"candidate_bearing": np.array(candidate.bearing)}
    if (imitation := judgement.imitation) is not None:
        middle = len(imitation.errors) // 2
        arrays |= {
            "controller_weights": imitation.weights,
            "controller_error": imitation.errors,
            "teacher_rolls": imitation.teacher_rolls,
            "self_rolls": np.stack([imitation.responses[i] for i in (0, middle, -1)]),
            "order": imitation.order,
        }
    if isinstance(judgement.model, TeacherRecord):
        kept = np.arange(len(steps))
        rig = rig_of(scenario)
        arrays |= _paper_arrays(judgement.model, true_parts, rig)
        arrays["controller_objective"] = _controller_objective(judgement, body, true_parts)
    else:
        kept = _kept(judgement.model)
        if not isinstance(judgement.model, Glance):
            arrays |= _motion_arrays(judgement, body, true_parts)
        if isinstance(judgement.model, Embodiment):
            arrays |= _explanations(judgement.model, kept)
    arrays["look_steps"] = steps[kept]
    arrays["images"] = candidate.watched.frames[np.array(judgement.looks)[kept]]
    arrays["truth_parts"] = true_parts[kept]
    return arrays


def candidate_row(judgement: Judgement, arrays: Arrays) -> Row:
    """A mind's verdict on a teacher, how sure it is and why, and the ends of its errors."""
    verdict, controller = judgement.verdict, judgement.controller_verdict
    row: Row = {
        "verdict": verdict.answer,
        "score": verdict.score,
        "probability": verdict.probability,
        "reason": verdict.reason,
    }
    if controller is not None:
        row |= {
            "controller_verdict": controller.answer,
            "controller_score": controller.score,
            "controller_probability": controller.probability,
        }
    if isinstance(judgement.model, JointFit):
        row["explained"] = judgement.model.explained
    if isinstance(judgement.model, Embodiment):
        other = judgement.model.best_other
        row |= {"explained": judgement.model.own.explained, "best_other": other.name}
        row |= {name: getattr(judgement.model, name) for name in ("unexplained", "left_over")}
        row["explained_by_other"] = other.explained
    for name, array in _ERRORS.items():
        if array in arrays:
            row |= zip(_ends_of(name), (_finite(arrays[array][end]) for end in (0, -1)), strict=True)
    if "motion_roll_error" in arrays:
        errors = arrays["motion_roll_error"]
        if np.all(np.isfinite(errors)):
            row["motion_roll_error_median_deg"] = float(np.degrees(np.median(errors)))
            row["motion_roll_error_worst_deg"] = float(np.degrees(errors.max()))
            row["parts_in_place"] = bool(np.all(errors < IN_PLACE))
            imitated = float(np.median(arrays["imitated_roll_error"]))
            row["imitated_roll_error_median_deg"] = math.degrees(imitated)
    return row


def rig_of(scenario: Scenario) -> StereoRig:
    """The student's eyes."""
    rig = scenario.rig
    return StereoRig(field_of_view=math.radians(rig.field_of_view_deg), baseline=rig.baseline)


def _paper_arrays(model: TeacherRecord, true_parts: Vector, rig: StereoRig) -> Arrays:
    passes, looks = len(model.error), len(true_parts)
    after_each_pass = model.history[len(model.history) // passes - 1 :: len(model.history) // passes]
    beliefs = np.concatenate([model.initial[None], after_each_pass])
    look_of = np.maximum(np.arange(passes + 1) - 1, 0) * looks // passes
    new = np.ones(passes + 1, dtype=bool)  # most passes change nothing
    new[1:] = np.any(beliefs[1:] != beliefs[:-1], axis=(1, 2)) | (np.diff(look_of) != 0)
    told = [(beliefs[number], true_parts[look_of[number]]) for number in np.flatnonzero(new)]
    since = np.cumsum(new) - 1
    errors = np.array([truth.teacher_model_error(parts, true) for parts, true in told])[since]
    return {
        "model_history": beliefs,
        "model_error": model.error,
        "pixels": model.pixels,
        "model_position_error": errors[:, 0],
        "model_roll_error": errors[:, 1],
        "model_overlap": np.array([truth.overlap(parts, true, rig) for parts, true in told])[since],
    }


def _controller_objective(judgement: Judgement, body: Morphology, true_parts: Vector) -> Vector:
    imitation = judgement.imitation
    if imitation is None:
        return np.empty(0)
    true_rolls = true_parts[:, truth.in_motor_order(body)][..., OMEGA]
    if true_rolls.shape[1] != imitation.teacher_rolls.shape[1]:
        return np.full(len(imitation.errors), np.nan)  # other parts than the student's: nothing to compare
    objective = np.empty(len(imitation.errors))
    for index, response in enumerate(imitation.responses):
        same = index > 0 and response is imitation.responses[index - 1]
        objective[index] = objective[index - 1] if same else truth.controller_error(response, true_rolls)
    return objective


def _kept(model: Modelled) -> NDArray[np.int64]:
    """Which frames are kept as pictures: those in which bodies were compared, or some evenly spread ones."""
    times = model.motion.times
    if isinstance(model, Embodiment):
        return np.searchsorted(times, model.best_other.motion.times - 1e-6)
    return np.unique(np.linspace(0, len(times) - 1, KEPT_IMAGES).round().astype(int))


def _motion_arrays(judgement: Judgement, body: Morphology, true_parts: Vector) -> Arrays:
    model = judgement.model
    position, roll = motion_errors(model.motion.parts, true_parts)
    imitated = np.full_like(roll, math.nan)
    if roll.shape[1] == true_parts.shape[1] and judgement.imitation is not None:
        seen = model.motion.parts[:, judgement.imitation.order, OMEGA]
        imitated = np.abs(
            read_rolls(seen - true_parts[:, truth.in_motor_order(body)][..., OMEGA], "half_turn")
        )
    return {
        "motion_times": model.motion.times,
        "motion_parts": model.motion.parts,
        "motion_position_error": position,
        "motion_roll_error": roll,
        "imitated_roll_error": imitated,
    }


def _explanations(model: Embodiment, kept: NDArray[np.int64]) -> Arrays:
    bodies = (model.own, model.best_other)
    return {
        "explanation_parts_0": model.motion.parts[kept],
        "explanation_parts_1": model.best_other.motion.parts,
        "explained": np.array([body.explained for body in bodies]),
        "explanation_words": np.array([body.words for body in bodies]),
        "evidence": np.array([body.log_likelihood for body in model.explanations]),
        "evidence_names": np.array([body.name for body in model.explanations]),
    }


def motion_errors(parts: Vector, true: Vector) -> tuple[Vector, Vector]:
    """How far the objects (F, k, 8) of a motion are from the true parts (F, n, 8).

    Which object is which part is decided once for all frames: together the centres are nearest.

    Returns:
        Mean distance of centres in each frame (F,) in m, and the error of each object's roll modulo half a turn
        (F, k) in rad, NaN where there are not as many objects as parts.
    """
    gaps = np.linalg.norm(parts[:, :, None, X : Z + 1] - true[:, None, :, X : Z + 1], axis=3)
    if np.isnan(gaps).any():  # nobody knows the truth
        return np.full(len(parts), math.nan), np.full(parts.shape[:2], math.nan)
    objects, those = linear_sum_assignment(gaps.mean(axis=0))
    position = gaps[:, objects, those].mean(axis=1)
    if parts.shape[1] != true.shape[1]:
        return position, np.full(parts.shape[:2], math.nan)
    turned = read_rolls(parts[:, objects, OMEGA] - true[:, those, OMEGA], "half_turn")
    return position, np.abs(turned)


def _finite(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None
