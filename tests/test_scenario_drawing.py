"""Concrete scenarios: a function of seed, cell and trial, with bodies, gaits and gaps drawn within their bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from testbed.bodies.morphology import load_robot
from testbed.errors import UserError
from testbed.resources import robot_names, scenario_names
from testbed.scenario import GaitSpec, cell_names, check, drawn, in_cell, load_scenario, parse_scenario
from testbed.scenario.bodies import BodyPlan
from testbed.scenario.drawing import drawn_gait
from testbed.scenario.teacher import waved
from testbed.scenario.view import nearest_distance
from testbed.world.gaits import scripted_policy

RANDOM = """\
seed: 4
trials: 20
student: {robot: {random: {limbs: 3}}}
teachers:
  - robot: {choice: [crawler, four_chain, ball]}
    gait: random
    scale: {log_uniform: [0.5, 2]}
    limb_scale: [{uniform: [0.6, 1.4]}, {uniform: [0.6, 1.4]}]
    distance: {uniform: [0.5, 2]}
"""


def test_scenarios_without_chance_are_their_own_trials() -> None:
    for name in ("paper", "whom_to_imitate"):
        scenario = load_scenario(name)
        assert drawn(scenario, 3) is scenario


def test_a_trial_is_the_same_whenever_it_is_drawn_and_unlike_any_other() -> None:
    scenario = parse_scenario(RANDOM)
    trials = [drawn(scenario, trial) for trial in range(20)]
    assert trials[7] == drawn(parse_scenario(RANDOM), 7)
    assert len({repr(trial.teachers) for trial in trials}) == 20
    assert {teacher.robot for trial in trials for teacher in trial.teachers} == {
        "crawler",
        "four_chain",
        "ball",
    }
    for trial in trials:
        assert trial.variation == {}
        assert drawn(trial, 3) == trial
        check(trial)
    other = parse_scenario(RANDOM.replace("seed: 4", "seed: 5"))
    assert drawn(other, 7).teachers != trials[7].teachers


def test_a_drawn_teacher_stands_where_it_fits_and_no_nearer() -> None:
    scenario = parse_scenario(RANDOM)
    moved = 0
    for trial in range(20):
        teacher = drawn(scenario, trial).teachers[0]
        nearest = nearest_distance(teacher.body(), teacher, scenario.rig)
        assert teacher.distance >= nearest
        moved += math.isclose(teacher.distance, nearest, abs_tol=2e-3)
    assert 0 < moved < 20
    stubborn = parse_scenario(RANDOM + "    fit: false\n", "x.yaml")
    with pytest.raises(UserError, match=r"x.yaml:9: .* does not fit in view"):
        check(stubborn)
    giant = parse_scenario(RANDOM.replace("[0.5, 2]}\n    limb", "[0.5, 9]}\n    limb"), "x.yaml")
    with pytest.raises(UserError, match=r"x.yaml:7: .* fits in view only from .* m on; make it smaller"):
        check(giant)


def test_a_body_has_the_size_and_the_limbs_that_its_teacher_says() -> None:
    text = "teachers: [{robot: four_chain, gait: still, scale: 0.5, limb_scale: [2, 1.5]}]"
    body = parse_scenario(text).teachers[0].body()
    plain = load_robot("four_chain")
    lengths = [part.length_along_x for part in body.parts.values()]
    assert lengths == pytest.approx([0.07, 0.2, 0.15, 0.1])
    assert body.parts["limb_a"].radius == 0.005  # type: ignore[union-attr]
    assert body.parts["limb_c"].density == plain.parts["limb_c"].density
    text = text.replace("[2, 1.5]", "2")
    assert [part.length_along_x for part in parse_scenario(text).teachers[0].body().parts.values()][1:] == [
        0.2
    ] * 3


@pytest.mark.parametrize("robot", robot_names())
def test_random_gaits_stay_within_every_bodys_travel_and_move_every_joint_that_can(robot: str) -> None:
    body = load_robot(robot)
    gait = GaitSpec.model_validate({"kind": "random", "random": {"second_harmonic": {"uniform": [0, 0.5]}}})
    for seed in range(20):
        concrete = drawn_gait(gait, body, np.random.default_rng(seed))
        assert 1.3 <= concrete.period <= 3.0
        if not body.joints:
            assert concrete.kind == "push"
            assert 0.04 <= concrete.speed <= 0.12
            continue
        policy = scripted_policy(concrete, body, concrete.period / 200)
        angles = np.array([policy.act({"gaze": np.zeros(1)}) for _ in range(200)])
        low, high = body.limits.T
        assert (angles >= low - 1e-6).all()
        assert (angles <= high + 1e-6).all()
        can = high - low > 0.1
        assert (np.degrees(np.ptp(angles, axis=0))[can] > 20).all()


def test_every_random_gait_passes_the_check() -> None:
    text = (
        "trials: 1\nteachers: [{robot: {choice: [locked, quadruped]}, distance: 3, gait: {kind: random, "
        "random: {centre: 1, second_harmonic: {uniform: [0, 1]}}}}]"
    )
    scenario = parse_scenario(text)
    for trial in range(60):
        check(drawn(scenario, trial))


def test_a_random_gait_has_yet_to_be_drawn() -> None:
    with pytest.raises(UserError, match="random gait has yet to be drawn"):
        scripted_policy(GaitSpec(kind="random"), load_robot("crawler"), 1 / 60)
    with pytest.raises(UserError, match="robot has yet to be drawn"):
        parse_scenario(RANDOM).student.body()


@pytest.mark.parametrize(("form", "top"), [("sine", 0.05), ("triangle", 0.03), ("trapezoid", 0.5)])
def test_wave_forms_share_a_rhythm_and_differ_at_their_tops(form: str, top: float) -> None:
    phase = np.linspace(0, 2 * math.pi, 4000, endpoint=False)
    wave = waved(phase, form)  # type: ignore[arg-type]
    assert (wave.min(), wave.max()) == pytest.approx((-1, 1))
    assert np.sign(wave[1:2000]).min() == 1  # crosses zero with the sine
    assert wave == pytest.approx(-waved(phase + math.pi, form), abs=1e-9)  # type: ignore[arg-type]
    assert np.mean(np.abs(wave) > 0.999) == pytest.approx(top, abs=0.05)


def test_harmonics_are_added() -> None:
    text = (
        "{period: 2, joints: {joint_a: {centre_deg: 10, amplitude_deg: 20, "
        "harmonics: [{order: 3, amplitude_deg: 5, phase_deg: 90}]}}}"
    )
    scenario = parse_scenario(f"teachers: [{{robot: crawler, gait: {text}}}]")
    policy = scripted_policy(scenario.teachers[0].gait, load_robot("crawler"), 0.05)
    angles = np.degrees([policy.act({"gaze": np.zeros(1)}) for _ in range(40)])
    turned = math.pi * 0.05 * np.arange(40)
    assert angles[:, 0] == pytest.approx(10 + 20 * np.sin(turned) + 5 * np.sin(3 * turned + math.pi / 2))
    assert not angles[:, 1].any()
    too_far = text.replace("centre_deg: 10", "centre_deg: 68")
    with pytest.raises(UserError, match="from 43 to 93 degrees"):
        check(parse_scenario(f"teachers: [{{robot: crawler, gait: {too_far}}}]"))


def test_random_trees_hang_every_limb_on_a_part_before_it() -> None:
    scenario = parse_scenario(RANDOM)
    plans = [drawn(scenario, trial).student.robot for trial in range(60)]
    on = []
    for plan in plans:
        assert isinstance(plan, BodyPlan)
        assert plan.tree is not None
        on.append([limb.on for limb in plan.tree])
        assert plan.tree[0].on == "main"
        assert len({limb.angle_deg for limb in plan.tree}) == 3
    assert {limbs[1] for limbs in on} == {"main", "limb_a"}
    assert {limbs[2] for limbs in on} == {"main", "limb_a", "limb_b"}
    body = drawn(scenario, 0).student.body()
    assert [len(body.parts), len(body.joints)] == [4, 3]
    assert body.parts["limb_c"] == load_robot("crawler").parts["limb_a"]


@pytest.mark.parametrize(
    ("robot", "fragments"),
    [
        ("{tree: [{on: limb_a}]}", ["limb 1 of the tree hangs on 'limb_a'", "choose among main"]),
        ("{tree: [{}, {on: limb_c}]}", ["limb 2 of the tree", "choose among main, limb_a"]),
        ("{parts_of: crawler}", ["needs either 'tree:' or 'random:'"]),
        ("{random: {limbs: 0}}", ["limbs must be between 1 and"]),
        ("{random: {limbs: 2}, parts_of: ball}", ["has no limbs to make a tree of"]),
        ("{random: {limbs: 2}, parts_of: bal}", ["unknown robot 'bal'", "did you mean 'ball'"]),
    ],
)
def test_plans_with_mistakes_are_refused(robot: str, fragments: list[str]) -> None:
    with pytest.raises(UserError) as caught:
        check(parse_scenario(f"student:\n  robot: {robot}\nteachers: []\n", "x.yaml"))
    assert str(caught.value).startswith("x.yaml:2: ")
    for fragment in fragments:
        assert fragment in str(caught.value)


GAP = "teachers: []\nseed: 1\nstudent:\n  reality_gap: {gap}\n"


def test_the_gap_is_drawn_for_each_joint_part_and_trial_by_itself() -> None:
    gap = "{servo_offset_deg: 3, limb_length: 0.1, density: {uniform: [-0.2, 0.2]}, tilt_bias_deg: [1, -1]}"
    scenario = parse_scenario(GAP.format(gap=gap))
    gaps = [drawn(scenario, trial).student.reality_gap for trial in range(200)]
    offsets = np.array([gap.servo_offset_deg for gap in gaps if gap])
    assert offsets.shape == (200, 2)
    assert offsets.std(axis=0) == pytest.approx([3, 3], rel=0.2)
    assert abs(np.corrcoef(offsets.T)[0, 1]) < 0.25
    lengths = np.array([gap.limb_length for gap in gaps if gap])
    assert lengths.mean() == pytest.approx(1, abs=0.03)
    assert lengths.std() == pytest.approx(0.1, rel=0.2)
    densities = np.array([gap.density for gap in gaps if gap])
    assert densities.shape == (200, 3)
    assert 0.8 <= densities.min() < 0.85
    assert {gap.tilt_bias_deg for gap in gaps if gap} == {(1.0, -1.0)}
    assert {gap.friction for gap in gaps if gap} == {(1.0, 1.0, 1.0)}


@pytest.mark.parametrize(
    ("student", "fragments"),
    [
        ("reality_gap: {servo_offset_deg: [1, 2, 3]}", ["has 3 values for robot 'crawler'", "give 2"]),
        ("reality_gap: {servo_offset: 1}", ["unknown key 'servo_offset'", "did you mean"]),
        ("damage: {limb_lost: limb_x}", ["damage.limb_lost is 'limb_x'", "does not have"]),
        ("damage: {joint_locked: limb_a}", ["damage.joint_locked is 'limb_a'", "joint_a"]),
        ("damage: {at: 3}", ["either 'limb_lost:' or 'joint_locked:'"]),
        ("damage: {limb_lost: random, joint_locked: random}", ["either 'limb_lost:' or"]),
    ],
)
def test_what_the_student_does_not_have_can_neither_differ_nor_break(
    student: str, fragments: list[str]
) -> None:
    with pytest.raises(UserError) as caught:
        check(parse_scenario(f"teachers: []\nstudent:\n  {student}\n", "x.yaml"))
    assert str(caught.value).startswith("x.yaml:3: ")
    for fragment in fragments:
        assert fragment in str(caught.value)


def test_random_damage_names_something_that_the_body_has() -> None:
    text = "teachers: []\nstudent: {damage: {choice: [{limb_lost: random}, {joint_locked: random}]}}"
    broken = {
        (damage.limb_lost, damage.joint_locked)
        for trial in range(40)
        if (damage := drawn(parse_scenario(text), trial).student.damage)
    }
    assert broken == {("limb_a", None), ("limb_b", None), (None, "joint_a"), (None, "joint_b")}


def test_a_ball_is_rolled_and_nobody_else() -> None:
    with pytest.raises(UserError, match="pushes robot 'crawler', which has joints"):
        check(parse_scenario("teachers: [{robot: crawler, gait: roll}]"))
    check(parse_scenario("teachers: [{robot: ball, gait: roll}]"))


@pytest.mark.parametrize("name", scenario_names())
def test_every_shipped_scenario_is_sound_in_every_cell(name: str) -> None:
    scenario = load_scenario(name)
    check(scenario)
    for cell in cell_names(scenario):
        concrete = drawn(in_cell(scenario, cell), 11)
        assert concrete.variation == {}
        assert concrete.minds


def test_the_verdict_scenario_has_a_hundred_of_either_and_every_kind() -> None:
    everything = in_cell(load_scenario("verdict"), "all")
    trials = [drawn(everything, trial) for trial in range(everything.trials)]
    assert len(trials) >= 100
    assert {trial.teachers[0].robot for trial in trials} == {"crawler"}
    kinds = [trial.teachers[1].robot for trial in trials]
    assert min(kinds.count(kind) for kind in set(kinds)) >= 5
    assert len(set(kinds)) == 8
    assert "crawler" not in kinds
