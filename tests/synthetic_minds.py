"""A run directory of invented numbers with several minds, cells, drawn robots and followed motions."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from synthetic_run import (
    CONTROL_STEP,
    DISTANCE,
    LOOKS,
    Array,
    Story,
    crawl,
    self_discovery,
    teacher,
    truth_parts,
)

from testbed.bodies.morphology import Morphology, load_robot
from testbed.experiment.verdicts import document, write
from testbed.scenario import cell_names, drawn, in_cell, parse_scenario, resolve
from testbed.vision import StereoRig, render

START, STEPS, FRAMES = 1300, 180, 60
SCENARIO = """
name: minds
description: Invented numbers.
trials: {trials}
student: {{method: like_me, robot: {robot}}}
teachers: {teachers}
{beside}
cells: {cells}
"""
TWO_TEACHERS = (
    "[{robot: crawler, gait: crawl, bearing_deg: -30}, {robot: {choice: [splayed, two_part, four_chain, ball]}, \
gait: random, bearing_deg: 30, distance: 1.2}]"
)
ABLATION = "{name: attachment, method: like_me, teacher_modelling: joint_fit, verdict: attachment}"


@dataclass(frozen=True)
class Plan:
    """What is to have happened.

    Attributes:
        trials: How many trials each cell has.
        teachers: As in a scenario.
        beside: The minds beside ``like_me``.
        cells: As in a scenario.
        robot: The student's.
        skill: By mind: how far apart it scores the two kinds of teachers.
        followed: Of how many trials there are arrays of whole motions.
    """

    trials: int = 1
    teachers: str = TWO_TEACHERS
    beside: str = "[paper]"
    cells: str = "{}"
    robot: str = "crawler"
    skill: tuple[tuple[str, float], ...] = (("like_me", 3.5), ("paper", 0.4), ("attachment", 2.5))
    followed: int = 3


def write_minds_run(directory: Path, plan: Plan | None = None) -> Path:
    """Write the run directory of a plan; returns it."""
    plan = plan or Plan()
    beside = f"beside: {plan.beside}" if plan.teachers != "[]" else ""
    text = SCENARIO.format(**{**vars(plan), "beside": beside})
    scenario = parse_scenario(text, directory / "scenario.yaml")
    rng = np.random.default_rng(3)
    rows: list[dict[str, Any]] = []
    known: dict[str, tuple[Array, Array]] = {}
    for cell in cell_names(scenario):
        here = in_cell(scenario, cell)
        folder = directory / "trials" / cell
        folder.mkdir(parents=True)
        for trial in range(here.trials):
            concrete = drawn(here, trial)
            base: dict[str, Any] = {"trial": trial, "cell": cell}
            arrays: dict[str, Array] = {"time/control_step": np.array(CONTROL_STEP)}
            student = concrete.student.body()
            arrays["truth/student/joints"], arrays["truth/student/base"] = _moves(student, -1.0, known)
            for mind in here.minds:
                prefix = "" if mind is here.minds[0] else f"beside/{mind.name}/"
                names = {**base, "student": mind.name}
                own, itself = _itself(mind.phases.self_discovery, student, rng)
                told: dict[str, Any] = {}
                if cell == "damage":
                    named = f"limb_lost limb_{'b' if trial % 5 else 'a'}"
                    told = {"damage": "limb_lost limb_b", "damage_found": named}
                    told |= {"damage_named_right": trial % 5 > 0, "damage_noticed_after": 1.0 + trial % 4}
                    told |= {"damage_named_right_first": trial % 2 > 0, "alarm_withdrawn": False}
                    told |= {"left_topology_right": True, "left_angle_error_deg": 1.0 + trial}
                    told |= {"left_angle_error_deg_first": 4.0 + trial}
                rows.append({"kind": "self", **names, "robot": student.name, **itself, **told})
                arrays |= {f"{prefix}{key}": value for key, value in own.items()}
                for index, spec in enumerate(concrete.teachers):
                    name, body = f"teacher_{index}", spec.body()
                    judged = _judged(plan, mind.name, body, rng)
                    chosen = mind is here.minds[0] and judged["verdict"] == "appropriate" and index == 0
                    row = {"kind": "verdict", **names, "teacher": name, "chosen": chosen, **judged}
                    row |= {"scale": spec.scale, "distance": spec.distance, "facing_deg": spec.facing_deg}
                    if f"truth/{name}/base" not in arrays:
                        moves = _moves(body, DISTANCE, known)
                        arrays[f"truth/{name}/joints"], arrays[f"truth/{name}/base"] = moves
                    if chosen:
                        row |= _travelled(rng)
                        arrays |= {"perform/start_step": np.array(START), "perform/steps": np.array(STEPS),
                                   "perform/path": arrays["truth/student/base"][START - 1 :, :3]}  # fmt: skip
                    if trial < plan.followed or row["verdict"] != row["truth"]:
                        joints, places = arrays[f"truth/{name}/joints"], arrays[f"truth/{name}/base"]
                        if mind.phases.teacher_modelling == "eea":
                            made, ends = teacher(Story(), name, body, joints, places, row["truth"], 60, rng)
                        else:
                            made, ends = _followed(name, body, joints, places, known, rng)
                        arrays |= {f"{prefix}{key}": value for key, value in made.items()}
                        row |= ends
                    rows.append(row)
            np.savez_compressed(folder / f"{trial}.npz", allow_pickle=False, **arrays)
    write(directory, document("minds", "0123abcd", rows, seed=0))
    (directory / "provenance.json").write_text(json.dumps({"python": "3.11.7", "seed": 0}))
    (directory / "scenario.resolved.yaml").write_text(resolve(scenario))
    return directory


def _moves(body: Morphology, depth: float, known: dict[str, tuple[Array, Array]]) -> tuple[Array, Array]:
    key = f"{body.model_dump_json()} {depth}"
    if key not in known:
        known[key] = crawl(body, START + STEPS, depth)
    return known[key]


def _judged(plan: Plan, mind: str, body: Morphology, rng: np.random.Generator) -> dict[str, Any]:
    like = body.name == "crawler"
    gap = dict(plan.skill)[mind]
    score = float(rng.normal(gap / 2 if like else -gap / 2))
    yes = score > 0
    best = "its second limb hangs on its body"
    return {
        "robot": body.name, "truth": "appropriate" if like else "inappropriate",
        "verdict": "appropriate" if yes else "inappropriate", "score": score, "found": True,
        "probability": None if mind == "paper" else 1 / (1 + math.exp(-gap * score)),
        "reason": "" if mind == "paper" else "my own body explains 96% of what I saw, no other body more" if yes
        else "its second limb moves with the body, not with the first limb; my own body explains 61% of what I saw, "
        "the best other body 93%",
        "controller_verdict": "appropriate" if yes else "inappropriate",
        "controller_score": score + float(rng.normal()),
        "explained": 0.96 if yes else 0.61, "best_other": best, "explained_by_other": 0.93,
    }  # fmt: skip


def _itself(
    method: str, body: Morphology, rng: np.random.Generator
) -> tuple[dict[str, Array], dict[str, Any]]:
    if method == "hill_climber" and len(body.joints) == 2:
        own = self_discovery(Story(), rng)
        return own, {"topology_right": True, "angle_error_deg": 3.0, "commands": 10}
    from testbed.student.body.self_model import true_tree

    parents, angles = true_tree(body)
    steps, limbs = 11, len(parents)
    right_after, gaps = int(rng.integers(1, 5)), rng.normal(0, 0.4, (steps, limbs))
    tried = np.tile(parents, (steps, 1))
    tried[:right_after, -1] = 0 if parents[-1] else 1
    error = gaps * np.exp(-np.arange(steps) / 1.5)[:, None]
    commands = rng.uniform(-1, 1, (steps - 1, limbs))
    own = {
        "self/parents": tried,
        "self/angles": angles + error,
        "self/truth_parents": np.array(parents),
        "self/truth_angles": angles,
        "self/error": np.exp(-np.arange(steps) / 2),
        "self/objective": 0.2 * np.exp(-np.arange(steps) / 2),
        "self/commands": commands,
        "self/tilt": rng.normal(0, 0.2, (steps - 1, 2)),
        "self/words": np.array(
            ["I know what my limbs hang on.", "The angle of limb b could be its mirror image."]
        ),
    }
    return own, {
        "topology_right": bool(rng.random() < 0.97), "angle_error_deg": float(np.degrees(np.abs(error[-1]).max())),
        "commands": steps - 1, "identifiable": bool(rng.random() < 0.7),
        "posterior_holds_truth": bool(rng.random() < 0.96), "evaluations": float(rng.integers(900, 2000)),
    }  # fmt: skip


def _travelled(rng: np.random.Generator) -> dict[str, float]:
    teacher_forward, ratio = float(rng.uniform(0.06, 0.2)), float(rng.normal(0.9, 0.2))
    return {
        "path_length": 0.3, "path_forward": teacher_forward * ratio * 1.5, "performed_seconds": 6.0,
        "teacher_forward": teacher_forward, "watched_seconds": 4.0, "distance_ratio": ratio,
    }  # fmt: skip


def _followed(
    name: str,
    body: Morphology,
    joints: Array,
    base: Array,
    known: dict[str, tuple[Array, Array]],
    rng: np.random.Generator,
) -> tuple[dict[str, Array], dict[str, Any]]:
    times = np.arange(FRAMES) / 15
    steps = np.array([LOOKS[0] + 4 * frame for frame in range(FRAMES)])
    base = base - np.array([0.4, 0, 0, 0, 0, 0, 0], np.float32)  # into view
    parts = np.stack([truth_parts(body, base[step], joints[step]) for step in steps])
    kept = np.unique(np.linspace(0, FRAMES - 1, 8).round().astype(int))
    rig = StereoRig()
    images = np.stack([render(truth, rig, 110) for truth in parts[kept]])
    images = np.clip(images + rng.normal(0, 2, images.shape), 0, 255).astype(np.uint8)
    crawler = load_robot("crawler")
    moved = _moves(crawler, DISTANCE, known)[0]
    own = np.stack([truth_parts(crawler, base[step], moved[step]) for step in steps])
    seen = own + rng.normal(0, 0.002, own.shape) * [0, 1, 1, 1, 20, 0, 0, 0]
    rolls = seen[np.linspace(0, FRAMES - 1, 240).astype(int), :, 4]
    errors = np.exp(-np.arange(40) / 9)
    same = parts.shape[1] == 3
    roll_error = np.abs(seen[..., 4] - own[..., 4]) if same else np.full((FRAMES, 3), np.nan)
    arrays = {
        "motion_times": times, "motion_parts": seen, "motion_roll_error": roll_error,
        "look_steps": steps[kept], "images": images, "truth_parts": parts[kept],
        "explanation_parts_0": seen[kept], "explanation_parts_1": parts[kept], "explained": np.array([0.61, 0.93]),
        "explanation_words": np.array(["my own body", "its second limb hangs on its body"]),
        "teacher_rolls": rolls, "order": np.arange(3), "controller_error": errors,
        "self_rolls": np.stack([rolls + gap * np.sin(np.linspace(0, 9, 240))[:, None] for gap in (0.5, 0.3, 0.05)]),
    }  # fmt: skip
    row = {"initial_error": float(errors[0]), "final_error": float(errors[-1])}
    if same:
        row["motion_roll_error_median_deg"] = float(np.degrees(np.median(roll_error)))
        row["motion_roll_error_worst_deg"] = float(np.degrees(roll_error.max()))
    return {f"{name}/{key}": value for key, value in arrays.items()}, row
