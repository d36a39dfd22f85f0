"""What happens by itself: balls that roll when they are watched, limbs that fall off, joints that seize."""

from __future__ import annotations

import math

import numpy as np
import pytest

from testbed.scenario import Scenario, check, drawn, parse_scenario
from testbed.world.bullet import SimulatedBackend
from testbed.world.env import World
from testbed.world.placement import STUDENT

BALL = "teachers:\n  - {robot: ball, gait: {kind: push, speed: 0.1, period: 4}, bearing_deg: 40, facing_deg: 20}\n"
CRAWLER = "teachers:\n  - {robot: crawler, gait: crawl}\n"


def play(backend: SimulatedBackend, steps: int, pan: float, command: tuple[float, ...] = (0.0, 0.0)) -> None:
    targets = {
        name: np.array(command) if name == STUDENT else body.rest for name, body in backend.robots.items()
    }
    for _ in range(steps):
        backend.apply(targets, pan)


@pytest.fixture
def ball() -> SimulatedBackend:
    scenario = parse_scenario(BALL)
    check(scenario)
    return SimulatedBackend(scenario)


def test_a_ball_rolls_without_slipping_to_and_fro_while_it_is_watched(ball: SimulatedBackend) -> None:
    bearing = math.radians(40)
    play(ball, 60, 0.0)
    start, _ = ball.state("teacher_0")
    play(ball, 60, bearing)  # the rig arrives while it rolls
    play(ball, 60, bearing)
    there, _ = ball.state("teacher_0")
    travelled = there[:2] - start[:2]
    yaw = math.radians(20 - 40)
    assert math.atan2(travelled[1], travelled[0]) == pytest.approx(yaw, abs=0.01)
    assert 0.1 < np.linalg.norm(travelled) < 0.2
    # rolled by its own radius for each radian turned
    turned = 2 * math.acos(abs(there[6]))
    assert np.linalg.norm(travelled) == pytest.approx(0.07 * turned, rel=0.03)
    play(ball, 120, bearing)
    back, _ = ball.state("teacher_0")
    assert np.linalg.norm(back[:2] - start[:2]) < 0.1
    play(ball, 30, 0.0)
    held, _ = ball.state("teacher_0")
    play(ball, 60, 0.0)
    assert ball.state("teacher_0")[0][:2] == pytest.approx(held[:2], abs=1e-3)


def damaged(damage: str, robot: str = "crawler", more: str = "") -> SimulatedBackend:
    scenario = parse_scenario(CRAWLER + f"student: {{robot: {robot}, damage: {damage}{more}}}")
    check(scenario)
    return SimulatedBackend(drawn(scenario, 0))


def test_a_lost_limb_is_gone_with_all_that_hangs_on_it_and_commands_keep_their_number() -> None:
    backend = damaged("{limb_lost: limb_a, at: 0.5}")
    play(backend, 30, 0.0)
    assert len(backend.bodies_now()[STUDENT].parts) == 3
    play(backend, 1, 0.0)
    assert list(backend.bodies_now()[STUDENT].parts) == ["body"]
    assert len(backend.robots[STUDENT].joints) == 2  # nobody is told
    play(backend, 60, 0.0, (0.5, -0.5))
    base, joints = backend.state(STUDENT)
    assert base[2] == pytest.approx(0.025, abs=1e-3)
    assert joints.tolist() == [0, 0]


def test_the_rest_of_the_body_goes_on_moving_after_a_loss() -> None:
    backend = damaged("{limb_lost: limb_b, at: 0.1}", "splayed")
    play(backend, 60, 0.0, (0.6, 0.6))
    _, joints = backend.state(STUDENT)
    assert joints == pytest.approx([0.6, 0], abs=0.02)
    assert backend.tilt(STUDENT)[1] < math.radians(-5)  # propped up at one end only


def test_a_locked_joint_stays_where_it_is() -> None:
    backend = damaged("{joint_locked: joint_a, at: 1}")
    play(backend, 60, 0.0, (0.5, 0.2))
    _, before = backend.state(STUDENT)
    play(backend, 60, 0.0, (-0.5, -0.8))
    _, after = backend.state(STUDENT)
    assert before == pytest.approx([0.5, 0.2], abs=0.02)
    assert after == pytest.approx([before[0], -0.8], abs=0.02)


@pytest.mark.parametrize("damage", ["{limb_lost: limb_b, at: 0.5}", "{joint_locked: joint_b, at: 0.5}"])
def test_an_episode_with_damage_repeats_bit_for_bit(damage: str) -> None:
    backend = damaged(damage)

    def episode(backend: SimulatedBackend) -> bytes:
        backend.reset(np.random.SeedSequence(3))
        states: list[np.ndarray] = []
        rng = np.random.default_rng(0)
        for _ in range(100):
            targets = {name: np.asarray(rng.uniform(*body.limits.T)) for name, body in backend.robots.items()}
            backend.apply(targets, 0.2)
            states += [*backend.state(STUDENT), backend.tilt(STUDENT), backend.look().ravel()]
        return np.concatenate(states).tobytes()

    first = episode(backend)
    assert len(backend.bodies_now()[STUDENT].parts) == (2 if "limb_lost" in damage else 3)
    assert episode(backend) == first
    assert episode(damaged(damage)) == first


def test_the_true_body_differs_from_the_known_one_by_the_reality_gap() -> None:
    gap = (
        "reality_gap: {servo_offset_deg: [5, -3], limb_length: [1.2, 0.9], density: [1, 2, 1], "
        "friction: [1, 1, 0.5], tilt_bias_deg: [2, -1]}"
    )
    scenario = parse_scenario(CRAWLER + f"student: {{{gap}}}\nworld: {{tilt_noise_deg: 0}}")
    check(scenario)
    backend = SimulatedBackend(drawn(scenario, 0))
    known, true = backend.robots[STUDENT], backend.bodies_now()[STUDENT]
    assert [true.parts[name].length_along_x for name in ("limb_a", "limb_b")] == pytest.approx([0.24, 0.18])
    assert true.parts["limb_a"].density == 2 * known.parts["limb_a"].density
    assert true.parts["limb_b"].friction == 0.5 * known.parts["limb_b"].friction
    play(backend, 60, 0.0, (-0.3, -0.2))
    _, joints = backend.state(STUDENT)
    assert joints == pytest.approx([-0.3 + math.radians(5), -0.2 - math.radians(3)], abs=0.01)
    assert backend.tilt(STUDENT) == pytest.approx(np.radians([2, -1]), abs=0.005)
    play(backend, 60, 0.0, (math.pi / 2, -math.pi / 2))
    assert np.abs(backend.state(STUDENT)[1]).max() <= math.pi / 2 + 0.02  # no further than the hinge goes


def test_a_rig_with_a_loose_servo_rests_beside_its_target_and_stays_there() -> None:
    def rests(error: float) -> list[float]:
        backend = SimulatedBackend(parse_scenario(CRAWLER + f"rig: {{pan_error_deg: {error}}}"))
        found = []
        for target in (0.1, 0.2, 0.3):
            play(backend, 30, target)
            first = backend.pan
            play(backend, 10, target)
            assert backend.pan == first
            found.append(first - target)
        return found

    assert rests(0.0) == pytest.approx([0, 0, 0])
    errors = rests(4.0)
    assert len(set(errors)) == 3
    assert 0 < max(map(abs, errors)) < math.radians(16)


def test_robots_whose_joints_cannot_lie_flat_start_as_flat_as_they_can(scenario: Scenario) -> None:
    text = "teachers:\n  - {robot: rigid, gait: still}\n"
    world = World(parse_scenario(text))
    observations, _ = world.reset(seed=1)
    assert world.observation_space("teacher_0").contains(observations["teacher_0"])
    rest = world.backend.robots["teacher_0"].rest
    assert np.degrees(rest) == pytest.approx([14.5, 34.5])
    assert observations["teacher_0"]["joints"] == pytest.approx(rest)
    world.close()


def test_a_student_may_live_alone_and_a_world_draws_what_is_left_to_chance() -> None:
    world = World(parse_scenario("teachers: []\nstudent: {robot: {random: {limbs: 4}}}"))
    observations, _ = world.reset(seed=2)
    assert list(observations) == [STUDENT]
    assert world.action_space(STUDENT).shape == (5,)
    observations, *_ = world.step({STUDENT: world.action_space(STUDENT).sample()})
    assert world.observation_space(STUDENT).contains(observations[STUDENT])
    world.close()
