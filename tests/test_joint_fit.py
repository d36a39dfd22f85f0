"""Articulated bodies and free parts: kinematics, derivatives, and what comes of films whose truth is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from films import RIG, film
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.bodies.morphology import Morphology, load_robot
from testbed.student.moving.rolls import headings, roll_of
from testbed.student.parameters import FittingParameters, JointFitParameters
from testbed.student.seeing._bundle import costs, linearised
from testbed.student.seeing.alternatives import own_limbs
from testbed.student.seeing.articulated import describe, eyes_of, lay_out
from testbed.student.seeing.bundling import Fit, Prior, _schur, bundle, score
from testbed.student.seeing.fitting import film_of
from testbed.student.seeing.joint_fit import ends_of, joint_fit, pointed_away
from testbed.student.seeing.posing import best_few, depth_of
from testbed.vision.silhouette import coverage

WAVES = [(-25.0, 25.0, 0.0), (35.0, 25.0, 80.0)]


def tree(parents: list[int], angles: list[float]) -> Morphology:
    """A random body: limb i hangs on part ``parents[i]`` (0 is the box) at ``angles[i]`` degrees."""
    names = ["box", *(f"limb_{i}" for i in range(len(parents)))]
    parts: dict[str, object] = {"box": {"shape": "cuboid", "size": [0.14, 0.11, 0.05]}}
    parts |= {name: {"shape": "capped_cylinder", "radius": 0.01, "length": 0.12} for name in names[1:]}
    joints = {
        f"joint_{i}": {"parent": names[parent], "child": names[i + 1], "angle_deg": angle, "height": 0.01}
        for i, (parent, angle) in enumerate(zip(parents, angles, strict=True))
    }
    return Morphology.model_validate({"name": "tree", "parts": parts, "joints": joints})


bodies = st.lists(
    st.tuples(st.floats(0, 1), st.floats(-180, 180), st.floats(-1.4, 1.4)), min_size=1, max_size=4
)


@settings(max_examples=40, deadline=None)
@given(bodies, st.floats(-1.2, 1.2), st.floats(-0.3, 0.3), st.sampled_from([1, -1]))
def test_plans_move_as_morphologies_do(
    limbs: list[tuple[float, float, float]], roll: float, yaw: float, facing: int
) -> None:
    body = tree([int(share * i) for i, (share, _, _) in enumerate(limbs)], [angle for _, angle, _ in limbs])
    turns = np.array([turn for _, _, turn in limbs])
    plan_limbs, order = own_limbs(body)
    plan = lay_out(plan_limbs, facing)
    x = np.zeros((1, plan.pose + plan.shared))
    x[0, plan.find("turn", 0)] = roll
    for joint, turn in enumerate(turns, start=1):
        x[0, plan.find("turn", joint)] = turn
    x[0, plan.find("depth")], x[0, plan.find("yaw")] = 1.5, yaw
    ours = describe(plan, x)[0]
    # The world beside it: x right, y forward, z up; the body is turned left for a plane that recedes to the right.
    heading = yaw + (0.0 if facing == 1 else math.pi)
    base = np.eye(4)
    c, s = math.cos(heading), math.sin(heading)
    base[:3, :3] = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array(
        [[math.cos(roll), 0, math.sin(roll)], [0, 1, 0], [-math.sin(roll), 0, math.cos(roll)]]
    )
    poses = list(body.poses(turns).values())
    centres = np.array([(base @ pose)[:3, 3] for pose in poses])[list(order)]
    np.testing.assert_allclose(ours[:, 1], centres[:, 0], atol=1e-12)
    np.testing.assert_allclose(ours[:, 2], -centres[:, 2], atol=1e-12)
    np.testing.assert_allclose(ours[:, 3] - 1.5, centres[:, 1], atol=1e-12)
    axes = np.array([(base @ pose)[:3, 0] for pose in poses])[list(order)]
    along = np.hypot(axes[:, 0], axes[:, 2]) > 1e-6
    gap = ours[:, 4] - roll_of(axes, np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(np.sin(gap / 2)[along], 0, atol=1e-9)


def test_headings_of_the_world_agree_with_plans() -> None:
    body = load_robot("crawler")
    _, parts = film(body, WAVES, frames=2, yaw=0.0, roll_deg=0.0)
    joints = np.radians([[-25.0, 35.0 + 25.0 * math.sin(math.radians(80))]])
    rolls = roll_of(headings(body, np.array([[0, 0, 0, 0, 0, 0, 1.0]]), joints)[0], np.array([1.0, 0, 0]))
    np.testing.assert_allclose(parts[0, :, 4], rolls, atol=1e-9)


@pytest.fixture(scope="module")
def crawler() -> tuple:
    watched, parts = film(load_robot("crawler"), WAVES)
    return watched, parts


def test_gradient_is_that_of_the_cost(crawler: tuple) -> None:
    watched, _ = crawler
    seen = film_of(watched, RIG, FittingParameters())
    plan = lay_out(own_limbs(load_robot("crawler"))[0])
    x = np.tile([-0.08, 0.12, 0.03, -0.5, 0.9, 0.05, 1.02, 0.02, 0.03, -0.04], (2, 1))
    frames, free = np.array([0, 5]), np.arange(10)
    steps = np.full(10, 1e-5)
    cost, gradient, matrix = linearised(plan.plan, 7, seen.eyes, frames, x, free, steps)
    np.testing.assert_allclose(cost, costs(plan.plan, 7, seen.eyes, frames, x), rtol=1e-12)
    for j in free:
        up, down = x.copy(), x.copy()
        up[:, j] += 1e-5
        down[:, j] -= 1e-5
        slope = (score(plan, seen.eyes, frames, up) - score(plan, seen.eyes, frames, down)) / 4e-5
        np.testing.assert_allclose(gradient[:, j], slope, rtol=0.02, atol=0.02 * np.abs(gradient).max())
    assert np.all(np.linalg.eigvalsh(matrix) > -1e-6 * np.abs(matrix).max())


def test_cost_is_what_the_rendering_leaves(crawler: tuple) -> None:
    watched, _ = crawler
    seen = film_of(watched, RIG, FittingParameters())
    plan = lay_out(own_limbs(load_robot("crawler"))[0])
    x = np.array([[-0.05, 0.1, 0.0, -0.3, 0.4, 0.0, 1.0, 0.0, 0.0, 0.0]])
    expected = np.sum((coverage(describe(plan, x)[0], RIG) - seen.eyes.alpha[3]) ** 2)
    assert score(plan, seen.eyes, np.array([3]), x)[0] == pytest.approx(expected, rel=1e-6)
    nothing = score(plan, seen.eyes, np.array([3]), x, 0)[0]
    assert nothing == pytest.approx(np.sum(seen.eyes.alpha[3].astype(float) ** 2), rel=1e-6)


def test_schur_complement_solves_the_whole_system() -> None:
    rng = np.random.default_rng(0)
    frames, m, q = 4, 3, 2
    a = rng.normal(size=(frames, 30, m + q))
    matrix, gradient = np.einsum("fri,frj->fij", a, a), rng.normal(size=(frames, m + q))
    poses, shared = _schur(matrix, gradient, m, 0.0, np.full(m + q, 1e9), np.zeros(q), np.zeros(q))
    whole = np.zeros((frames * m + q, frames * m + q))
    right = np.zeros(frames * m + q)
    for f in range(frames):
        own = slice(f * m, f * m + m)
        whole[own, own] = matrix[f, :m, :m]
        whole[own, frames * m :] = matrix[f, :m, m:]
        whole[frames * m :, own] = matrix[f, m:, :m]
        whole[frames * m :, frames * m :] += matrix[f, m:, m:]
        right[own] = gradient[f, :m]
        right[frames * m :] += gradient[f, m:]
    step = -np.linalg.solve(whole, right)
    np.testing.assert_allclose(np.r_[poses.ravel(), shared], step, rtol=1e-6)


def test_bundle_keeps_what_is_held_and_what_is_bounded(crawler: tuple) -> None:
    watched, _ = crawler
    seen = film_of(watched, RIG, FittingParameters())
    plan = lay_out(own_limbs(load_robot("crawler"))[0])
    x = np.tile([-0.08, 0.12, 0.0, -0.45, 1.0, 0.1, 1.0, 0.02, 0.03, -0.04], (3, 1))
    frames = np.array([0, 1, 2])
    start = Fit(plan, frames, x[:, :5], x[0, 5:], score(plan, seen.eyes, frames, x), seen.eyes.blank[frames])
    free = np.array([np.inf] * 5)
    prior = Prior(np.zeros(5), np.array([0, np.inf, 0, 0, 0]), np.array([-9, 2, -9, 0.02, -9]), free)
    fit = bundle(start, seen.eyes, prior)
    assert fit.cost.sum() < start.cost.sum()
    assert fit.shared[1] == 1.0
    assert fit.shared[3] >= 0.02


def test_depth_comes_from_disparity() -> None:
    for depth in (0.8, 1.6):
        watched, _ = film(load_robot("crawler"), WAVES, frames=4, depth=depth, yaw=0.0)
        assert film_of(watched, RIG, FittingParameters()).depth == pytest.approx(depth, rel=0.02)
    assert depth_of(np.zeros((2, 2, 75, 100), np.float32), RIG) == 1.0


def test_best_few_keeps_the_cheapest_of_each_frame() -> None:
    frames = np.array([0, 1, 0, 1, 0])
    cost = np.array([3.0, 1.0, 2.0, 5.0, 1.0])
    assert best_few(frames, cost, 2).tolist() == [4, 2, 1, 3]
    assert best_few(frames, cost, 2, np.array([[7], [1], [7], [1], [7]])).tolist() == [4, 1]


def test_free_parts_are_found_and_point_away(crawler: tuple) -> None:
    watched, parts = crawler
    found = joint_fit(watched, RIG, tuple(load_robot("crawler").parts.values()))
    gap = found.motion.parts[:, :, 4] - parts[:, :, 4]
    assert np.degrees(np.abs(np.angle(np.exp(1j * gap)))).max() < 4.0
    assert np.degrees(np.median(np.abs(np.angle(np.exp(1j * gap))))) < 1.0
    assert np.linalg.norm(found.motion.parts[:, :, 1:4] - parts[:, :, 1:4], axis=-1).max() < 0.03
    assert found.explained > 0.98
    assert found.scale == pytest.approx(1.0, abs=0.04)
    assert np.all(found.needed > 0.1)
    assert np.abs(np.diff(found.motion.parts[:, :, 4], axis=0)).max() < math.pi / 2
    np.testing.assert_array_equal(found.motion.times, watched.times)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.booleans(), min_size=2, max_size=2), st.integers(-2, 2))
def test_limbs_are_turned_to_point_away(flipped: list[bool], turns: int) -> None:
    _, parts = film(load_robot("crawler"), WAVES, frames=6)
    rows = parts.copy()
    for limb, flip in enumerate(flipped, start=1):
        rows[:, limb, 4] += math.pi * flip + 2 * math.pi * turns * (np.arange(6) % 2)
    np.testing.assert_allclose(np.cos(pointed_away(rows)[:, :, 4] - parts[:, :, 4]), 1.0, atol=1e-12)


def test_ends_are_where_hinges_sit() -> None:
    _, parts = film(load_robot("crawler"), WAVES, frames=3, yaw=0.0)
    ends = ends_of(parts)
    np.testing.assert_allclose(ends[:, 1, 0], ends[:, 0, 1], atol=1e-9)
    np.testing.assert_allclose(ends[:, 2, 0], ends[:, 1, 1], atol=1e-9)


def test_an_empty_film_is_no_crash() -> None:
    watched, _ = film(load_robot("crawler"), WAVES, frames=4)
    empty = type(watched)(np.full_like(watched.frames, 255), watched.times)
    found = joint_fit(
        empty, RIG, tuple(load_robot("crawler").parts.values()), JointFitParameters(iterations=1)
    )
    assert found.motion.parts.shape == (4, 3, 8)
    assert np.all(np.isfinite(found.motion.parts))
    assert eyes_of(np.zeros((1, 2, 75, 100), np.float32), RIG).blank[0] == 0.0
