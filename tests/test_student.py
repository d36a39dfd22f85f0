"""The student's phases, each against something that is not the student."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from testbed.bodies.morphology import Morphology, load_robot
from testbed.errors import UserError
from testbed.experiment.truth import is_like, self_model_error
from testbed.physics import Simulation
from testbed.student.body.imagination import Imagination
from testbed.student.body.self_discovery import (
    evolve_self_model,
    mutate,
    random_commands,
    random_genome,
    tilt_error,
)
from testbed.student.body.self_model import (
    BodyPrior,
    branch_columns,
    genome_of,
    self_model,
    tree_of,
    true_genome,
)
from testbed.student.judging.verdict import judge
from testbed.student.motion import TeacherMotion
from testbed.student.moving.imitation import controller, correspondence, evolve_controller, imitation_error
from testbed.student.moving.rolls import headings, read_rolls, roll_of, view_of
from testbed.student.parameters import (
    ImaginationParameters,
    ImitationParameters,
    SelfDiscoveryParameters,
    StudentParameters,
    VerdictParameters,
)
from testbed.student.search import HillClimber, choose_variables
from testbed.vision.camera import StereoRig
from testbed.vision.foreground import find_candidates

CRAWLER = load_robot("crawler")
PRIOR = BodyPrior.of(CRAWLER)


def nothing(done: int, total: int) -> None:
    """No progress."""


# What the student knows


def test_the_prior_says_nothing_about_how_the_parts_are_joined() -> None:
    raised = CRAWLER.varied(joints={"joint_a": {"height": 0.02}, "joint_b": {"angle_deg": 70, "along": 0.3}})
    assert BodyPrior.of(CRAWLER) == BodyPrior.of(load_robot("splayed")) == BodyPrior.of(raised)


def test_the_prior_needs_a_limb() -> None:
    one = Morphology.model_validate({"name": "one", "parts": {"body": {"shape": "sphere", "radius": 0.1}}})
    with pytest.raises(UserError, match="has 0"):
        BodyPrior.of(one)


@given(limbs=st.integers(1, 8), seed=st.integers(0, 2**32 - 1))
def test_a_genome_tells_every_tree_of_limbs(limbs: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    genome = random_genome(limbs, rng)
    parents, angles = tree_of(genome)
    assert all(0 <= parent <= limb for limb, parent in enumerate(parents))
    assert np.array_equal(genome_of(parents, angles), genome)
    part = {"shape": "capped_cylinder", "radius": 0.01, "length": 0.2}
    box = {"shape": "cuboid", "size": [0.14, 0.11, 0.05]}
    body = Morphology.model_validate(
        {
            "name": "some",
            "parts": {
                "body": box,
                **dict.fromkeys("abcdefgh"[:limbs], part),
            },
            "joints": {
                f"j{limb}": {
                    "parent": "abcdefgh"[parent - 1] if parent else "body",
                    "child": "abcdefgh"[limb],
                    "angle_deg": math.remainder(math.degrees(angle), 360),
                }
                for limb, (parent, angle) in enumerate(zip(parents, angles, strict=True))
            },
        }
    )
    again = true_genome(body)
    assert np.allclose(again[branch_columns(limbs)], genome[branch_columns(limbs)])
    assert self_model_error(self_model(BodyPrior.of(body), genome), body) == pytest.approx(0.0, abs=1e-9)


def test_a_motion_is_sampled_evenly_and_mixed_between_its_moments() -> None:
    parts = np.arange(4.0)[:, None, None] * np.ones((1, 1, 8))
    motion = TeacherMotion(np.arange(4.0), parts)
    assert motion.sampled(2)[:, 0, 0].tolist() == [1.0, 3.0]
    assert motion.sampled(4)[:, 0, 0].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert motion.thinned(2).times.tolist() == [1.0, 3.0]
    assert motion.thinned(4) is motion
    assert motion.sampled(8)[:, 0, 0].tolist() == [0.0, 0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0]


@pytest.mark.parametrize("name", ["crawler", "splayed"])
def test_the_true_genome_makes_the_true_body(name: str) -> None:
    body = load_robot(name)
    assert self_model_error(self_model(PRIOR, true_genome(body)), body) == pytest.approx(0.0, abs=1e-12)


# Search


def test_the_hill_climber_keeps_a_parent_until_it_is_strictly_beaten() -> None:
    climber = HillClimber(np.zeros(1), 2.0)
    assert not climber.tell(np.ones(1), 2.0)
    assert climber.tell(np.full(1, 5.0), 1.0)
    assert climber.errors == [2.0, 2.0, 1.0]
    assert climber.parent[0] == 5.0


@given(st.integers(1, 30), st.integers(1, 5), st.integers(0, 5), st.integers(0, 2**32 - 1))
def test_one_to_three_different_variables(count: int, fewest: int, extra: int, seed: int) -> None:
    fewest = min(fewest, count)
    chosen = choose_variables(np.random.default_rng(seed), count, fewest, fewest + extra)
    assert fewest <= len(chosen) <= fewest + extra
    assert len(set(chosen.tolist())) == len(chosen)
    assert set(chosen.tolist()) <= set(range(count))


# Self-discovery


def test_equation_1() -> None:
    felt, believed = np.array([[0.3, 0.0], [0.0, 0.1]]), np.array([[0.0, 0.0], [0.0, -0.3]])
    assert tilt_error(felt, believed) == pytest.approx(0.5)


def test_lambda_stays_binary_and_angles_move() -> None:
    rng, parameters = np.random.default_rng(1), SelfDiscoveryParameters()
    genome = np.array([1.0, 0.0, 2.0])
    children = np.array([mutate(genome, parameters, rng) for _ in range(300)])
    assert set(children[:, 1]) == {0.0, 1.0}
    moved = (children != genome).sum(axis=1)
    assert moved.max() == 3
    assert 0.5 < np.std(children[children[:, 0] != 1.0, 0]) < 2.0


def test_an_imagined_body_settles_as_a_real_one_does() -> None:
    """The shortcut of stopping at rest against the whole wait."""
    commands = np.random.default_rng(4).uniform(*PRIOR.limits.T, (8, 2))
    with Imagination(ImaginationParameters(), 1 / 60) as imagination:
        believed = imagination.settle(CRAWLER, commands, limit=1.5, rest_speed=0.02)
    for command, tilt in zip(commands, believed, strict=True):
        with Simulation() as simulation:
            simulation.add("robot", CRAWLER)
            simulation.command("robot", command)
            simulation.step(480)
            assert tilt == pytest.approx(simulation.tilt("robot"), abs=math.radians(1.5))


def test_a_student_finds_its_body_better_than_chance() -> None:
    """Objective error after 50 iterations against that of random self-models, several seeds, development ones."""
    body, parameters = CRAWLER, SelfDiscoveryParameters()
    finals, randoms = [], []
    with Imagination(ImaginationParameters(), 1 / 60) as imagination:
        for seed in range(4):
            rng = np.random.default_rng([seed, 77])
            commands = random_commands(PRIOR, parameters, rng)
            tilt = imagination.settle(body, commands, limit=1.5, rest_speed=0.02)
            tilt += rng.normal(0, math.radians(0.5), tilt.shape)
            record = evolve_self_model(PRIOR, commands, tilt, imagination, parameters, rng, nothing)
            assert record.genomes.shape == (51, 3)
            assert (np.diff(record.errors) <= 0).all()
            assert tilt_error(tilt, record.believed_tilt[-1]) == pytest.approx(record.errors[-1])
            randoms.append(self_model_error(self_model(PRIOR, record.genomes[0]), body))
            finals.append(self_model_error(self_model(PRIOR, record.genome), body))
    assert np.mean(finals) < 0.6 * np.mean(randoms)


# Looking around


@settings(deadline=None)
@given(st.floats(-60, -25), st.floats(25, 60), st.floats(4, 12))
def test_candidates_are_found_where_they_are(first: float, second: float, width: float) -> None:
    rig = StereoRig()
    directions = np.degrees(np.arctan(rig.rays()[0, :, 0]))
    views = []
    for pan in range(-90, 91, 20):
        image = np.full((75, 100), 255, np.uint8)
        for bearing in (first, second):
            image[30:40, np.abs(directions + pan - bearing) <= width / 2] = 90
        views.append((math.radians(pan), image))
    found = find_candidates(views, rig, dark_below=180, gap=math.radians(5), narrowest=math.radians(3))
    assert np.degrees(found) == pytest.approx([first, second], abs=1.0)


def test_noise_is_no_candidate() -> None:
    rng = np.random.default_rng(0)
    views = [(0.0, np.clip(255 + rng.normal(0, 3, (75, 100)), 0, 255).astype(np.uint8))]
    assert find_candidates(views, StereoRig(), dark_below=180, gap=0.1, narrowest=0.05) == []
    assert find_candidates([], StereoRig(), dark_below=180, gap=0.1, narrowest=0.05) == []


# Rolls


def test_rolls_are_those_of_forward_kinematics() -> None:
    """Headings computed in one go against the poses of every part, one by one."""
    body = CRAWLER.varied(joints={"joint_a": {"angle_deg": 40}, "joint_b": {"angle_deg": -70}})
    rng = np.random.default_rng(2)
    joints = rng.uniform(-1.5, 1.5, (5, 2))
    bases = np.tile([0.0, 0, 0, 0, 0, 0, 1], (5, 1))
    for step, angles in enumerate(joints):
        expected = [pose[:3, 0] for pose in body.poses(angles).values()]
        assert headings(body, bases, joints)[step] == pytest.approx(np.array(expected))


def test_a_limb_that_points_down_to_the_right_has_a_positive_roll() -> None:
    right = np.array([1.0, 0, 0])
    assert roll_of(np.array([math.cos(0.4), 0, -math.sin(0.4)]), right) == pytest.approx(0.4)


@given(hnp.arrays(float, (6, 3), elements=st.floats(-10, 10)))
def test_half_turns_are_read_away(rolls: np.ndarray) -> None:
    read = read_rolls(rolls, "half_turn")
    assert ((read >= -math.pi / 2) & (read <= math.pi / 2)).all()
    turns = (read - rolls) / math.pi
    assert turns == pytest.approx(np.round(turns), abs=1e-6)
    steps = np.diff(read_rolls(rolls, "unwrapped"), axis=0)
    assert (np.abs(steps) <= math.pi / 2 + 1e-9).all()
    assert read_rolls(rolls, "raw") is rolls


@pytest.mark.parametrize("alpha", [0.0, 1.0, math.pi, 4.0])
def test_the_student_sees_itself_with_the_last_limb_to_the_right(alpha: float) -> None:
    _, places = view_of(self_model(PRIOR, np.array([alpha, 0.0, 0.0])))
    assert places[0, 0] < places[1, 0] < places[2, 0]


# Imitation


def test_equation_5_after_reordering() -> None:
    theirs, order = np.array([[1.0, 2.0, 3.0]]), np.array([1, 0, 2])
    assert imitation_error(theirs, order, np.array([[2.0, 1.0, 3.0]])) == 0.0
    assert imitation_error(theirs, order, np.array([[2.0, 1.0, 1.0]])) == pytest.approx(2.0)


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_parts_correspond_from_left_to_right_whatever_the_size_and_place(order: tuple[int, ...]) -> None:
    _, own = view_of(CRAWLER)
    theirs = (own * 1.7 + (0.3, 0.2))[list(order)]
    assert [order[i] for i in correspondence(own, theirs)] == [0, 1, 2]


@given(
    hnp.arrays(float, (2, 3), elements=st.floats(-20, 20)),
    hnp.arrays(float, (7, 3), elements=st.floats(-1.6, 1.6)),
)
def test_commands_stay_within_the_joints_travel(weights: np.ndarray, rolls: np.ndarray) -> None:
    limits = np.radians([[-90.0, 90.0], [-30.0, 60.0]])
    commands = controller(weights, rolls, limits)
    assert commands.shape == (7, 2)
    assert (commands >= limits[:, 0] - 1e-12).all()
    assert (commands <= limits[:, 1] + 1e-12).all()
    middle = controller(np.zeros((2, 3)), rolls, limits)
    assert middle == pytest.approx(np.tile(limits.mean(axis=1), (7, 1)))


def history_of(rolls: np.ndarray, xs: tuple[float, ...]) -> np.ndarray:
    history = np.zeros((len(rolls), 3, 8))
    history[..., 1] = xs
    history[..., 4] = rolls
    return history


def test_a_motion_that_the_body_can_make_is_imitated() -> None:
    """A reachable target: the rolls of the student's own body under a known network."""
    parameters = ImitationParameters(iterations=60, samples=40)
    rng = np.random.default_rng(5)
    seen = np.cumsum(rng.normal(0, 0.05, (40, 3)), axis=0)
    right, _ = view_of(CRAWLER)
    with Imagination(ImaginationParameters(), 1 / 60) as imagination:
        with imagination.imagine(CRAWLER) as rehearsal:
            moved = rehearsal.move(controller(rng.uniform(-1, 1, (2, 3)), seen, CRAWLER.limits))
        rolls = roll_of(headings(CRAWLER, *moved), right)
        record = evolve_controller(
            CRAWLER,
            history_of(rolls, (0.0, 0.2, 0.4)),
            imagination,
            parameters,
            np.random.default_rng(1),
            nothing,
        )
    assert record.order.tolist() == [0, 1, 2]
    assert record.weights.shape == (61, 2, 3)
    assert (np.abs(record.weights[0]) <= 1).all()
    assert record.errors[-1] < 0.6 * record.errors[0]
    assert imitation_error(rolls, record.order, record.responses[-1]) == pytest.approx(record.errors[-1])


# Verdict


def test_verdicts_are_drawn_as_the_parameters_say() -> None:
    errors = np.array([10.0, 8.0, 6.0])
    assert (
        judge(errors, 100, VerdictParameters(score="relative_reduction", threshold=0.4)).answer
        == "appropriate"
    )
    assert (
        judge(errors, 100, VerdictParameters(score="relative_reduction", threshold=0.41)).answer
        == "inappropriate"
    )
    final = judge(errors, 100, VerdictParameters(score="final_error", threshold=-0.7))
    assert (final.answer, final.score) == ("appropriate", pytest.approx(-0.6))


def test_like_me_is_the_plan_of_the_body_not_its_size() -> None:
    assert is_like(CRAWLER, CRAWLER.scaled(2.0))
    assert is_like(CRAWLER, CRAWLER.varied(parts={"limb_b": {"length": 0.1, "luminosity": 10}}))
    assert not is_like(CRAWLER, load_robot("splayed"))
    assert not is_like(CRAWLER, CRAWLER.varied(joints={"joint_b": {"angle_deg": 90}}))


def test_either_score_has_a_threshold_of_its_own() -> None:
    errors = np.array([10.0, 5.0])
    assert judge(errors, 100, VerdictParameters(score="final_error")).answer == "appropriate"
    assert judge(errors, 100, VerdictParameters(score="relative_reduction")).answer == "appropriate"
    assert judge(errors, 10, VerdictParameters(score="final_error")).answer == "inappropriate"


@given(st.integers(1, 5), st.integers(1, 2000), st.integers(1, 9))
def test_every_student_can_be_hurried(pairs: int, passes: int, iterations: int) -> None:
    modelling = {"image_pairs": pairs, "passes_per_image": passes, "estimation_iterations": iterations}
    length = pairs * passes * iterations
    if length < 2:
        return
    samples = min(count for count in range(2, length + 1) if length % count == 0)
    parameters = StudentParameters.model_validate(
        {"teacher_modelling": modelling, "imitation": {"samples": samples}}
    )
    hasty = parameters.smoke()
    assert hasty.teacher_modelling.passes_per_image == 30
    assert hasty.imitation.iterations <= 6
