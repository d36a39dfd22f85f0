"""A run directory made of invented numbers, whole enough for the report to be drawn from it.

What happens in it is chosen by the caller, so that tests can see the report's words follow the numbers.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Cuboid, Morphology, Sphere, load_robot
from testbed.experiment.verdicts import document, write
from testbed.vision import StereoRig, render

Array = NDArray[Any]
CONTROL_STEP = 1 / 60
HEIGHT, DISTANCE = 0.15, 0.9
LOOKS = (900, 960, 1020)
PERFORM_START, PERFORM_STEPS = 1300, 180


@dataclass(frozen=True)
class Story:
    """What is to have happened.

    Attributes:
        trials: How many trials.
        robots: The teachers' robots, by name; "crawler" is the appropriate one.
        chosen: Which teacher the student imitates; None: nobody.
        found: Which teachers the student found by itself.
        falling: By truth: whether controller errors fall.
        models_fall: Whether the self-models' and teacher models' errors fall.
        right: Share of right verdicts.
        seed: Of the invented noise.
    """

    trials: int = 1
    robots: tuple[str, ...] = ("crawler", "splayed")
    chosen: int | None = 0
    found: tuple[bool, ...] = (True, True)
    falling: tuple[tuple[str, bool], ...] = (("appropriate", True), ("inappropriate", False))
    models_fall: bool = True
    right: float = 1.0
    seed: int = 0


def write_synthetic_run(directory: Path, story: Story | None = None, *, passes: int = 300) -> Path:
    """Write the run directory of a story; returns it."""
    story = story or Story()
    rng = np.random.default_rng(story.seed)
    rows: list[dict[str, Any]] = []
    folder = directory / "trials" / "default"
    folder.mkdir(parents=True)
    for trial in range(story.trials):
        arrays, trial_rows = _trial(story, trial, passes, rng)
        np.savez_compressed(folder / f"{trial}.npz", allow_pickle=False, **arrays)
        rows += trial_rows
    _write_documents(directory, story, rows)
    return directory


def _write_documents(directory: Path, story: Story, rows: list[dict[str, Any]]) -> None:
    write(directory, document("synthetic", "0123abcd", rows, seed=0))
    provenance = {"python": "3.11.7", "packages": {"numpy": "2.4.6", "pybullet": "3.2.7"}, "seed": 0}
    (directory / "provenance.json").write_text(json.dumps(provenance))
    teachers = "".join(f"- {{robot: {robot}, gait: crawl, bearing_deg: 0}}\n" for robot in story.robots)
    (directory / "scenario.resolved.yaml").write_text(
        "name: synthetic\ndescription: Invented numbers.\nseed: 0\n"
        f"student: {{method: paper, robot: crawler}}\nteachers:\n{teachers}"
        "rig: {height: 0.15, field_of_view_deg: 50, baseline: 0.1}\nworld: {control_step: 0.0166667}\n"
    )


def _trial(
    story: Story, trial: int, passes: int, rng: np.random.Generator
) -> tuple[dict[str, Array], list[dict[str, Any]]]:
    student = load_robot("crawler")
    arrays: dict[str, Array] = {"time/control_step": np.float64(CONTROL_STEP)}  # type: ignore[dict-item]
    arrays |= self_discovery(story, rng)
    rows: list[dict[str, Any]] = []
    chosen = story.chosen
    for index, robot in enumerate(story.robots):
        name, body = f"teacher_{index}", load_robot(robot)
        truth = "appropriate" if robot == "crawler" else "inappropriate"
        joints, base = crawl(body, PERFORM_START + PERFORM_STEPS, DISTANCE)
        arrays[f"truth/{name}/joints"], arrays[f"truth/{name}/base"] = joints, base
        correct = rng.random() < story.right
        verdict = truth if correct else ("inappropriate" if truth == "appropriate" else "appropriate")
        score = float(rng.normal(0.6 if verdict == "appropriate" else 0.1, 0.08))
        row: dict[str, Any] = {
            "trial": trial, "cell": "default", "student": "paper", "teacher": name, "robot": robot,
            "truth": truth, "verdict": verdict, "score": score,
            "score_low": None, "score_high": None, "found": story.found[index], "chosen": index == chosen,
            "path_length": 0.31 if index == chosen else None, "path_forward": 0.12 if index == chosen else None,
            "teacher_forward": 0.09 + 0.01 * float(rng.random()),
        }  # fmt: skip
        if story.found[index]:
            watched, posed = teacher(story, name, body, joints, base, truth, passes, rng)
            arrays |= watched
            row |= posed
        else:
            row |= dict.fromkeys(
                ("initial_error", "final_error", "objective_initial_error", "objective_final_error",
                 "model_position_error_initial", "model_position_error_final",
                 "model_overlap_initial", "model_overlap_final")
            )  # fmt: skip
        row["self_error_initial"] = float(arrays["self/objective"][0])
        row["self_error_final"] = float(arrays["self/objective"][-1])
        rows.append(row)
    joints, base = crawl(student, PERFORM_START + PERFORM_STEPS, -1.0)
    arrays["truth/student/joints"], arrays["truth/student/base"] = joints, base
    if chosen is not None:
        arrays["perform/start_step"] = np.int64(PERFORM_START)  # type: ignore[assignment]
        arrays["perform/steps"] = np.int64(PERFORM_STEPS)  # type: ignore[assignment]
        arrays["perform/path"] = base[PERFORM_START - 1 :, :3].astype(np.float64)
    return arrays, rows


def self_discovery(story: Story, rng: np.random.Generator) -> dict[str, Array]:
    steps = 51
    decay = np.exp(-np.arange(steps) / 12)[:, None] if story.models_fall else np.ones((steps, 1))
    decay = np.repeat(decay[::7], 7, axis=0)[:steps]
    start = np.array([rng.uniform(1, 3), 0.0, rng.uniform(-3, -1)])
    genome = decay * start + (1 - decay) * np.array([0.06, 0.0, 0.03])
    on_main = decay[:, 0] > 0.6
    jitter = rng.normal(0, 1e-3)
    objective = 0.01 + jitter**2 + 0.15 * decay[:, 0] * rng.uniform(0.8, 1.2)
    if not story.models_fall:
        objective = objective + rng.normal(0, 0.02, steps)
    commands = rng.uniform(-1, 1, (10, 2))
    tilt = rng.normal(0, 0.2, (10, 2))
    noise = rng.normal(0, 0.25, (10, 2))
    return {
        "self/parents": np.stack([np.zeros(steps, int), np.where(on_main, 0, 1)], axis=1),
        "self/angles": genome[:, [0, 2]],
        "self/truth_parents": np.array([0, 1]),
        "self/truth_angles": np.zeros(2),
        "self/error": 0.05 + 1.2 * decay[:, 0],
        "self/objective": objective,
        "self/commands": commands,
        "self/tilt": tilt,
        "self/believed_tilt": tilt + decay[:, :, None] * noise,
    }


def crawl(body: Morphology, steps: int, depth: float) -> tuple[Array, Array]:
    time = np.arange(steps) * CONTROL_STEP
    wave = np.sin(math.pi * time)
    joints = np.stack([0.5 * wave, *[0.9 + 0.4 * np.sin(math.pi * time + 2)] * 8], axis=1)[
        :, : len(body.joints)
    ]
    base = np.zeros((steps, 7))
    base[:, 0] = 0.02 * time - 0.15
    base[:, 1] = depth
    pitch = -0.12 * (1 + wave)
    base[:, 4], base[:, 6] = np.sin(pitch / 2), np.cos(pitch / 2)
    for step in range(steps):
        poses = _world_poses(body, base[step], joints[step])
        base[step, 2] = -min(_bottom(body, name, pose) for name, pose in poses.items())
    return joints.astype(np.float32), base.astype(np.float32)


def _world_poses(body: Morphology, base: Array, joints: Array) -> dict[str, Array]:
    pitch = 2 * math.atan2(base[4], base[6])
    c, s = math.cos(pitch), math.sin(pitch)
    root = np.array([[c, 0, s, base[0]], [0, 1, 0, base[1]], [-s, 0, c, base[2]], [0, 0, 0, 1]], dtype=float)
    return {name: root @ pose for name, pose in body.poses(joints).items()}


def _bottom(body: Morphology, name: str, pose: Array) -> float:
    part = body.parts[name]
    if isinstance(part, Cuboid):
        return float(pose[2, 3] - np.abs(pose[2, :3]) @ np.array(part.size) / 2)
    length = getattr(part, "length", 0.0)
    return float(pose[2, 3] - part.radius - abs(pose[2, 0]) * length / 2)


def truth_parts(body: Morphology, base: Array, joints: Array) -> Array:
    rows = []
    for name, pose in _world_poses(body, base, joints).items():
        part = body.parts[name]
        roll = math.atan2(-pose[2, 0], pose[0, 0])
        place = [pose[0, 3], HEIGHT - pose[2, 3], pose[1, 3]]
        if isinstance(part, Cuboid):
            rows.append([0, *place, roll, part.size[0], part.size[1], part.size[2]])
        elif isinstance(part, Sphere):
            rows.append([1, *place, roll, part.radius, 0.0, 0.0])
        else:
            rows.append([2, *place, roll, part.radius, part.length, 0.02])
    return np.array(rows, dtype=float)


def teacher(
    story: Story,
    name: str,
    body: Morphology,
    joints: Array,
    base: Array,
    truth: str,
    passes: int,
    rng: np.random.Generator,
) -> tuple[dict[str, Array], dict[str, Any]]:
    rig = StereoRig()
    parts = np.stack([truth_parts(body, base[look], joints[look]) for look in LOOKS])
    images = np.stack([render(model, rig, 110) for model in parts])
    images = np.clip(images + rng.normal(0, 2, images.shape), 0, 255).astype(np.uint8)
    done = np.arange(passes + 1)  # row p is the model after p passes
    pair = np.maximum(done - 1, 0) * 3 // passes
    fall = np.exp(-done / (passes / 6)) if story.models_fall else np.ones(passes + 1)
    like = parts[
        :, np.minimum(np.arange(3), parts.shape[1] - 1)
    ]  # whoever it is, the student imagines three parts
    offset = rng.normal(0, 0.08, (3, 8)) * np.array([0, 1, 1, 2, 6, 0.2, 0.2, 0.2])
    history = like[pair] + fall[:, None, None] * offset
    history[..., 5:] = np.maximum(history[..., 5:], 0.012)
    if not story.models_fall:
        history[1:, :, 1:4] += rng.normal(0, 0.01, (passes, 3, 3))
    wrong = np.linalg.norm((history - like[pair])[..., 1:4], axis=-1).mean(axis=1)
    v, u = np.nonzero(images[0, 0] < 250)
    seen = rng.integers(0, len(v), (passes, 2))
    pixels = np.stack([u[seen], v[seen]], axis=-1) + rng.integers(-4, 5, (passes, 2, 2))
    rolls = history[np.linspace(0, passes, 240).astype(int), :, 4]
    falls = dict(story.falling)[truth]
    curve = np.exp(-np.arange(501) / 90) if falls else np.ones(501)
    level = rng.uniform(9, 11)
    error = level * (0.25 + 0.75 * curve)
    objective = 0.02 * error + 0.1 + (rng.normal(0, 0.002, 501) if falls else rng.normal(0, 1e-4, 501))
    stages = []
    for progress in curve[[0, 250, 500]]:
        phase = np.linspace(0, 12, 240)[:, None] + np.arange(3)
        stages.append(rolls + progress * 0.5 * np.sin(phase))
    arrays = {
        f"{name}/candidate_bearing": np.float64(0.0),
        f"{name}/images": images,
        f"{name}/look_steps": np.array(LOOKS),
        f"{name}/model_history": history,
        f"{name}/model_error": np.stack([8 * fall[1:] + 1, 9 * fall[1:] + 1], axis=1),
        f"{name}/pixels": np.clip(pixels, 0, [99, 74]).astype(np.int16),
        f"{name}/model_position_error": wrong,
        f"{name}/model_roll_error": 0.5 * fall,
        f"{name}/model_overlap": 0.7 - 0.65 * fall,
        f"{name}/truth_parts": parts,
        f"{name}/controller_weights": rng.normal(0, 1, (501, 2, 3)),
        f"{name}/controller_error": error,
        f"{name}/controller_objective": objective,
        f"{name}/teacher_rolls": rolls,
        f"{name}/order": np.arange(3),
        f"{name}/self_rolls": np.stack(stages),
    }
    row = {
        "initial_error": float(error[0]),
        "final_error": float(error[-1]),
        "objective_initial_error": float(objective[0]),
        "objective_final_error": float(objective[-1]),
        "model_position_error_initial": float(wrong[0]),
        "model_position_error_final": float(wrong[-1]),
        "model_overlap_initial": 0.05,
        "model_overlap_final": float(0.7 - 0.65 * fall[-1]),
    }
    return arrays, row
