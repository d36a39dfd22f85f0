"""How teachers behave: presets, recordings, mirrors, stretched time, and answers to the student's own movement."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from testbed.bodies.morphology import Vector, load_robot
from testbed.errors import UserError
from testbed.physics import Simulation
from testbed.recording import read_recording
from testbed.scenario import GaitSpec, Scenario, check, content_hash, drawn, load_scenario, parse_scenario
from testbed.world.attention import Answering
from testbed.world.bullet import SimulatedBackend
from testbed.world.env import World
from testbed.world.gaits import PRESETS, scripted_policy
from testbed.world.mirror import twins

DT = 1 / 60
SEEN = {"gaze": np.zeros(1), "movement": np.zeros(1)}


def postures(gait: GaitSpec, robot: str = "crawler", steps: int = 240) -> Vector:
    policy = scripted_policy(gait, load_robot(robot), DT)
    return np.array([policy.act(SEEN) for _ in range(steps)])


def advance(robot: str, gait: GaitSpec, cycles: int = 3) -> float:
    """How far (m) a body comes along its x axis in each cycle, after the first."""
    body = load_robot(robot)
    steps = round(gait.period / DT)
    with Simulation() as simulation:
        simulation.add("it", body)
        for step, posture in enumerate(postures(gait, robot, (cycles + 1) * steps)):
            if step == steps:
                start = simulation.base("it")[0]
            simulation.command("it", posture)
            simulation.step(4)
        return float(simulation.base("it")[0] - start) / cycles


@pytest.mark.parametrize(
    ("robot", "preset", "least", "most"),
    [
        ("crawler", "crawl", 0.03, 0.08),
        ("crawler", "crawl_back", -0.08, -0.015),
        ("crawler", "wave", -0.003, 0.003),
        ("hand", "finger_walk", 0.05, 0.15),
    ],
)
def test_where_presets_lead(robot: str, preset: str, least: float, most: float) -> None:
    assert least < advance(robot, PRESETS[preset]) < most


def test_presets_with_something_else_said() -> None:
    gait = (
        parse_scenario("teachers:\n  - {robot: crawler, gait: {preset: crawl, stretched: 1.5}}")
        .teachers[0]
        .gait
    )
    assert gait == PRESETS["crawl"].model_copy(update={"stretched": 1.5})
    with pytest.raises(UserError, match="did you mean 'crawl'"):
        parse_scenario("teachers:\n  - {robot: crawler, gait: {preset: crawll}}")


@given(st.sampled_from([0.5, 2.0, 3.0]), st.sampled_from(["crawl", "wave"]))
@settings(max_examples=6, deadline=None)
def test_stretched_time(factor: float, preset: str) -> None:
    gait = PRESETS[preset]
    stretched = postures(gait.model_copy(update={"stretched": factor}), steps=120)
    same = np.array([postures(gait, steps=241)[round(step / factor)] for step in range(0, 120, 6)])
    np.testing.assert_allclose(stretched[::6], same, atol=1e-12)


def test_a_mirrored_demonstration_is_the_mirror_image() -> None:
    text = """
rig: {{camera_noise: 0, supersample: 6, light: {{direction: [0, -1, 1.5]}}}}
teachers:
  - {{robot: quadruped, scale: 0.6, facing_deg: 25, distance: 0.6, gait: {{mirrored: {mirrored}, joints: {{
      joint_a: {{amplitude_deg: 40}}, joint_c: {{centre_deg: -50}}, joint_f: {{centre_deg: 30, amplitude_deg: 20}}}}}}}}
"""
    views = []
    for mirrored in ("false", "true"):
        world = World(parse_scenario(text.format(mirrored=mirrored)))
        teacher = world.scenario.teachers[0]
        policy = scripted_policy(teacher.gait, world.backend.robots["teacher_0"], DT)
        observations, _ = world.reset(seed=1)
        for _ in range(8):
            acts = {"student": np.zeros(3, np.float32), "teacher_0": policy.act(observations["teacher_0"])}
            observations, *_ = world.step(acts)
        views.append((observations["student"]["left"], observations["student"]["right"]))
        world.close()
    (left, right), (mirrored_left, mirrored_right) = views
    dark = left < 200
    assert 0.02 < dark.mean() < 0.5
    for image, mirror in ((left, mirrored_right), (right, mirrored_left)):
        # Bullet's renderer is half a rendered pixel off the middle
        assert np.mean((image[:, ::-1] < 200) != (mirror < 200)) < 0.01
    assert np.mean(dark[:, ::-1] != dark) > 0.02, "the picture says nothing if it is its own mirror image"


@pytest.mark.parametrize(
    ("robot", "expected"),
    [
        ("crawler", [0, 1]),
        ("hand", [2, 3, 0, 1]),
        ("quadruped", [6, 7, 4, 5, 2, 3, 0, 1]),
        ("splayed", [0, 1]),
    ],
)
def test_twins(robot: str, expected: list[int]) -> None:
    assert twins(load_robot(robot)) == expected


CSV = "time,joint_a_deg\n1.0,0\n1.5,-40\n2.0,0\n"
REPLAY = "teachers:\n  - {robot: crawler, gait: {kind: replay, file: wave.csv}}\n"


@pytest.fixture
def replayed(tmp_path: Path) -> Scenario:
    (tmp_path / "wave.csv").write_text(CSV)
    (tmp_path / "replay.yaml").write_text(REPLAY)
    return load_scenario(tmp_path / "replay.yaml")


def test_a_recording_is_replayed_over_and_over(replayed: Scenario) -> None:
    check(replayed)
    shown = np.degrees(postures(drawn(replayed, 0).teachers[0].gait, steps=121))
    np.testing.assert_allclose(shown[[0, 15, 30, 60, 75, 90], 0], [0, -20, -40, 0, -20, -40], atol=1e-9)
    assert not shown[:, 1].any()


def test_parquet_says_the_same(tmp_path: Path, replayed: Scenario) -> None:
    table = arrow.table({"time": [1.0, 1.5, 2.0], "joint_a_deg": [0, -40, 0]})
    parquet.write_table(table, tmp_path / "wave.parquet")
    one, other = (read_recording(tmp_path / f"wave.{kind}") for kind in ("csv", "parquet"))
    np.testing.assert_array_equal(one.times, other.times)
    np.testing.assert_array_equal(one.angles["joint_a"], other.angles["joint_a"])


def test_what_a_recording_says_is_part_of_the_hash(tmp_path: Path, replayed: Scenario) -> None:
    before = content_hash(replayed)
    (tmp_path / "wave.csv").write_text(CSV.replace("-40", "-41"))
    assert content_hash(load_scenario(tmp_path / "replay.yaml")) != before


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty"),
        ("time,joint_a_deg\n0,1\n0,2\n", "time does not rise"),
        ("time,joint_a_deg\n0,1\n1,x\n", "wave.csv:3: a cell is no number"),
        ("time,joint_a_deg\n0,1\n1\n", "wave.csv:3: the row has 1 cells"),
        ("time,joint_a\n0,1\n1,2\n", "did you mean 'joint_a_deg'"),
        ("joint_a_deg\n0\n1\n", "no column 'time'"),
        ("time,joint_a_deg\n0,nan\n1,2\n", "not finite"),
        ("time,joint_a_deg\n0,1\n", "too little"),
        ("time,joint_z_deg\n0,1\n1,2\n", "joint 'joint_z', which robot 'crawler' does not have"),
        (
            "time,joint_a_deg\n0,1\n1,100\n",
            "replay.yaml:2: the recording turns joint 'joint_a' from 1 to 100",
        ),
    ],
)
def test_mistakes_in_recordings(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "wave.csv").write_text(text)
    (tmp_path / "replay.yaml").write_text(REPLAY)
    with pytest.raises(UserError) as caught:
        check(load_scenario(tmp_path / "replay.yaml"))
    assert said in str(caught.value)


CONTINGENT = """
teachers:
  - {robot: crawler, gait: {preset: crawl, when: answering, answer: {delay: 0.5, duration: 1.0}}, bearing_deg: 40}
"""


def test_a_contingent_teacher_answers_what_the_student_does() -> None:
    """It moves after the student has moved, whether or not anybody looks, and then lies still again."""
    world = World(parse_scenario(CONTINGENT))
    policy = scripted_policy(world.scenario.teachers[0].gait, world.backend.robots["teacher_0"], DT)
    observations, _ = world.reset(seed=2)
    moving = []
    for step in range(300):
        student = np.array([0.8 if step >= 60 else 0.0, 0.0, 0.0], np.float32)
        act = policy.act(observations["teacher_0"])
        moving.append(bool(np.any(act)))
        assert world.observation_space("teacher_0").contains(observations["teacher_0"])
        observations, *_ = world.step({"student": student, "teacher_0": act})
    world.close()
    steps = np.flatnonzero(moving)
    assert 60 + 0.5 / DT <= steps[0] <= 60 + 0.5 / DT + 5
    assert steps[-1] < 60 + (0.5 + 1.0 + 1.0) / DT  # the limb turns for less than a second
    assert steps[-1] > 60 + (0.5 + 1.0) / DT
    assert np.all(np.diff(steps) == 1)


@given(st.lists(st.booleans(), min_size=1, max_size=80))
@settings(max_examples=60, deadline=None)
def test_answers_come_only_after_movement(moves: list[bool]) -> None:
    """Whatever the student does: no answer without a movement at least the delay and at most delay + duration ago."""
    spec = GaitSpec(kind="still").answer.model_copy(update={"delay": 3 * DT, "duration": 5 * DT})
    occasion = Answering(spec, DT)
    for step, moved in enumerate(moves):
        speed = math.radians(spec.least_speed_deg) * (1.01 if moved else 0.99)
        answers = occasion.calls({"gaze": np.zeros(1), "movement": np.array([speed])})
        earlier = [step - then for then in range(step + 1) if moves[then]]
        assert not answers or (max(earlier) >= 3 and min(earlier) < 8)
        if moved and len(earlier) == 1:
            continue
        if earlier and max(earlier) >= 3 and min(earlier) < 8 and all(moves[: step + 1]):
            assert answers


def test_a_pushed_ball_can_answer_too() -> None:
    text = "teachers:\n  - {robot: ball, gait: {preset: roll, when: answering, answer: {delay: 0}}, bearing_deg: 30}"
    backend = SimulatedBackend(parse_scenario(text))
    start = backend.state("teacher_0")[0][:2]
    for step in range(110):
        student = np.array([0.0 if step < 60 else 0.8, 0.0])
        backend.apply({"student": student, "teacher_0": np.zeros(0)}, math.radians(30))
        if step == 59:
            assert np.linalg.norm(backend.state("teacher_0")[0][:2] - start) < 1e-4
    assert np.linalg.norm(backend.state("teacher_0")[0][:2] - start) > 0.03
    backend.close()


def test_a_box_slides_to_and_fro() -> None:
    backend = SimulatedBackend(parse_scenario("teachers:\n  - {robot: box, gait: slide}"))
    track = []
    for _ in range(120):
        backend.apply({"student": np.zeros(2), "teacher_0": np.zeros(0)}, 0.0)
        track.append(backend.state("teacher_0")[0])
    moved = np.array(track) - track[0]
    assert 0.05 < moved[:, 0].max() < 0.1
    assert abs(moved[-1, 0]) < 0.02
    assert np.abs(moved[:, 1:3]).max() < 0.005
    backend.close()
