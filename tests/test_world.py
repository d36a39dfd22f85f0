"""The world: PettingZoo's own test suite, whole episodes that repeat, and what each agent senses."""

from __future__ import annotations

import functools
import itertools
import math
from typing import Any

import numpy as np
import pettingzoo
import pytest
from pettingzoo.test import (
    api_test,
    max_cycles_test,
    parallel_api_test,
    parallel_seed_test,
    performance_benchmark,
    render_test,
    seed_test,
)

import testbed
from testbed.bodies.morphology import Morphology, load_robot
from testbed.physics import Simulation
from testbed.scenario import Scenario
from testbed.world.bullet import SimulatedBackend, physics_of
from testbed.world.env import World
from testbed.world.gaits import scripted_policy


@pytest.fixture
def world(scenario: Scenario) -> Any:
    world = testbed.parallel_env(scenario)
    yield world
    world.close()


def changed(scenario: Scenario, **world: float) -> Scenario:
    return scenario.model_copy(update={"world": scenario.world.model_copy(update=world)})


def test_parallel_api(world: World) -> None:
    parallel_api_test(world, num_cycles=60)


def test_aec_api(scenario: Scenario) -> None:
    api_test(testbed.env(scenario), num_cycles=60)


def test_seeds(scenario: Scenario) -> None:
    parallel_seed_test(functools.partial(testbed.parallel_env, scenario))
    seed_test(functools.partial(testbed.env, scenario), num_cycles=20)


def test_max_cycles(scenario: Scenario) -> None:
    def short(max_cycles: int) -> World:
        return testbed.parallel_env(changed(scenario, max_cycles=max_cycles))

    class Module:
        env = staticmethod(lambda max_cycles: testbed.env(changed(scenario, max_cycles=max_cycles)))
        parallel_env = staticmethod(short)

    max_cycles_test(Module)


def test_rendering(scenario: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both modes for real: the window draws into SDL's offscreen driver where there is no display."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    render_test(functools.partial(testbed.env, scenario))


def test_performance_benchmark_runs(scenario: Scenario) -> None:
    performance_benchmark(testbed.env(scenario))


def test_the_registry_knows_the_world(scenario: Scenario) -> None:
    testbed.register()
    made = pettingzoo.make("parallel", "testbed/whom_to_imitate-v0", scenario=scenario)
    made.reset(seed=1)
    assert made.possible_agents == ["student", "teacher_0", "teacher_1"]
    made.close()


def episode(world: World, seed: int, steps: int = 200) -> bytes:
    """Every observation, reward and ending of an episode of random actions, as bytes."""
    rng = np.random.default_rng(99)
    observations, _ = world.reset(seed=seed)
    log = []
    while world.agents and steps:
        log += [sense.tobytes() for agent in observations.values() for sense in agent.values()]
        spaces = {agent: world.action_space(agent) for agent in world.agents}
        actions = {agent: rng.uniform(space.low, space.high) for agent, space in spaces.items()}
        observations, rewards, *ends, _ = world.step(actions)
        log.append(repr((rewards, ends)).encode())
        steps -= 1
    return b"".join(log)


def test_a_seed_repeats_the_whole_episode_to_its_end(scenario: Scenario) -> None:
    scenario = changed(scenario, max_cycles=150)
    world = testbed.parallel_env(scenario)
    first = episode(world, seed=5)
    assert not world.agents
    assert episode(world, seed=5) == first
    assert episode(world, seed=6) != first
    world.close()
    afresh = testbed.parallel_env(scenario)
    assert episode(afresh, seed=5) == first
    afresh.close()


def test_a_reset_without_seed_goes_on_to_another_episode(world: World) -> None:
    world.reset(seed=5)
    first, _ = world.reset()
    second, _ = world.reset()
    assert not np.array_equal(first["student"]["left"], second["student"]["left"])
    world.reset(seed=5)
    again, _ = world.reset()
    assert np.array_equal(first["student"]["left"], again["student"]["left"])


def test_spaces_are_the_same_objects_and_hold_what_is_sensed(world: World) -> None:
    observations, _ = world.reset(seed=0)
    for agent in world.possible_agents:
        assert world.observation_space(agent) is world.observation_space(agent)
        assert world.action_space(agent) is world.action_space(agent)
        assert world.observation_space(agent).contains(observations[agent])
    assert set(observations["student"]) == {"tilt", "joints", "left", "right"}
    assert observations["student"]["left"].shape == (75, 100)


def rest(world: World) -> dict[str, np.ndarray]:
    return {agent: np.zeros(world.action_space(agent).shape) for agent in world.agents}


def test_the_rig_pans_at_its_own_speed_and_stops_at_its_limit(world: World) -> None:
    world.reset(seed=0)
    actions = rest(world) | {"student": np.array([0, 0, 9.9])}
    world.step(actions)
    assert world.backend.pan == pytest.approx(math.radians(90) / 60)
    for _ in range(100):
        world.step(actions)
    assert world.backend.pan == pytest.approx(math.pi / 2, abs=1e-6)


def test_panning_right_moves_what_is_seen_to_the_left_and_nearness_shows_in_disparity(
    scenario: Scenario,
) -> None:
    """Signs of pan and baseline, by the centre of what is dark."""
    backend = SimulatedBackend(scenario)
    backend.reset(np.random.SeedSequence(0))

    def middle(image: np.ndarray) -> float:
        return float(np.nonzero(image < 180)[1].mean())

    while backend.pan > math.radians(-30):
        backend.apply({}, math.radians(-30))
    for _ in range(4):
        backend.apply({}, math.radians(-30))
    left, right = backend.look()
    focal = 50 / math.tan(math.radians(25))
    assert middle(left) - middle(right) == pytest.approx(focal * 0.10 / 0.9, abs=1.0)
    for _ in range(8):
        backend.apply({}, math.radians(-25))
    assert middle(backend.look()[0]) < middle(left) - 5
    backend.close()


def test_images_have_noise_and_come_at_the_cameras_rate(world: World) -> None:
    observations, _ = world.reset(seed=0)
    frames = [observations["student"]["left"]]
    for _ in range(12):
        observations, *_ = world.step(rest(world))
        frames.append(observations["student"]["left"])
    changes = [not np.array_equal(a, b) for a, b in itertools.pairwise(frames)]
    assert sum(changes) == 3  # 15 images in 60 steps a second
    assert 1.0 < np.std(frames[-1].astype(float) - frames[0]) < 4.0


def test_what_is_seen_later_does_not_depend_on_pictures_that_nobody_wanted(scenario: Scenario) -> None:
    """White while they are not wanted, and no pictures; then as if all had been taken, noise and all."""
    worlds = [World(scenario, max_cycles=40) for _ in range(2)]
    for world in worlds:
        world.reset(seed=4)
    frame = round(1 / (scenario.rig.camera_rate * scenario.world.control_step))
    for step in range(1, 40):
        worlds[1].looking = not 2 * frame < step <= 5 * frame
        seen, spared = (world.step(rest(world))[0]["student"] for world in worlds)
        white = 3 * frame <= step < 6 * frame
        for side in ("left", "right"):
            expected = np.full_like(seen[side], 255) if white else seen[side]
            np.testing.assert_array_equal(spared[side], expected, err_msg=f"step {step}")
        np.testing.assert_array_equal(spared["tilt"], seen["tilt"])
    for world in worlds:
        world.close()


def test_a_teacher_feels_how_far_the_gaze_passes_it_by(world: World) -> None:
    observations, _ = world.reset(seed=0)
    assert observations["teacher_0"]["gaze"][0] == pytest.approx(math.radians(30))
    assert observations["teacher_1"]["gaze"][0] == pytest.approx(math.radians(-30))


def crawl(
    scenario: Scenario, teacher: int, cycles: int, body: Morphology | None = None
) -> tuple[float, float]:
    """Metres a cycle forward along the body's axis and sideways, the first cycle left out."""
    spec, world = scenario.teachers[teacher], scenario.world
    body = body or load_robot(spec.robot)
    policy = scripted_policy(spec.gait, body, world.control_step)
    steps = round(spec.gait.period / world.control_step)
    places = []
    with Simulation(physics_of(scenario)) as simulation:
        simulation.add("robot", body)
        for step in range(steps * (cycles + 1)):
            simulation.command("robot", policy.act({"gaze": np.zeros(1)}))
            simulation.step(world.physics_steps)
            if (step + 1) % steps == 0:
                places.append(simulation.base("robot")[:2])
    forward, sideways = (places[-1] - places[0]) / cycles
    return float(forward), float(abs(sideways))


@pytest.mark.parametrize("teacher", [0, 1])
def test_teachers_really_crawl_three_centimetres_a_cycle(scenario: Scenario, teacher: int) -> None:
    forward, sideways = crawl(scenario, teacher, cycles=4)
    assert forward >= 0.03
    assert sideways < forward / 3


def test_it_is_differential_friction_that_moves_the_crawler(scenario: Scenario) -> None:
    """With limbs and body of one coefficient the same strokes lead nowhere."""
    even = load_robot("crawler").varied(
        parts={name: {"friction": 0.9} for name in ("body", "limb_a", "limb_b")}
    )
    forward, _ = crawl(scenario, 0, cycles=3, body=even)
    assert abs(forward) < 0.005


@pytest.mark.parametrize("teacher", [0, 1])
def test_nobody_moves_without_friction(scenario: Scenario, teacher: int) -> None:
    forward, _ = crawl(changed(scenario, ground_friction=0.0), teacher, cycles=2)
    assert abs(forward) < 0.005


def test_teachers_wait_to_be_watched(world: World, scenario: Scenario) -> None:
    spec = scenario.teachers[0]
    policy = scripted_policy(spec.gait, world.backend.robots["teacher_0"], scenario.world.control_step)
    assert not policy.act({"gaze": np.array([0.5])}).any()
    begun = policy.act({"gaze": np.array([0.0])})
    policy.act({"gaze": np.array([0.1])})
    policy.act({"gaze": np.array([0.5])})
    assert np.array_equal(policy.act({"gaze": np.array([0.0])}), begun)
