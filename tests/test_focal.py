"""The world for one agent: Gymnasium's own checks, and the same life as in the world of many."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pettingzoo
import pytest
from gymnasium.utils.env_checker import check_env
from pettingzoo.utils.conversions import aec_to_parallel
from pettingzoo.utils.wrappers import BaseParallelWrapper, ClipOutOfBoundsWrapper, OrderEnforcingWrapper

import testbed
from testbed.scenario import Scenario
from testbed.world.focal import FocalWorld
from testbed.world.gaits import scripted_policy


@pytest.fixture
def moving(scenario: Scenario) -> Scenario:
    """Its teachers crawl whether or not they are watched."""
    teachers = [
        teacher.model_copy(update={"gait": teacher.gait.model_copy(update={"when": "always"})})
        for teacher in scenario.teachers
    ]
    rig = scenario.rig.model_copy(update={"renderer": "analytic"})
    return scenario.model_copy(update={"teachers": tuple(teachers), "rig": rig})


@pytest.mark.parametrize("images", [True, False])
def test_passes_gymnasiums_checks(scenario: Scenario, images: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    testbed.register()
    world = gymnasium.make(
        "testbed/whom_to_imitate-v0", scenario=scenario, render_mode="rgb_array", images=images
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*action space.*symmetric.*")
        check_env(world.unwrapped)
    assert set(world.observation_space.spaces) == {"tilt", "joints"} | (
        {"left", "right"} if images else set()
    )
    world.close()


def test_its_episode_is_the_one_that_the_student_lives_in_the_world_of_many(moving: Scenario) -> None:
    rng = np.random.default_rng(0)
    world, focal = testbed.parallel_env(moving), testbed.focal_env(moving)
    policies = {
        f"teacher_{index}": scripted_policy(teacher.gait, teacher.body(), moving.world.control_step)
        for index, teacher in enumerate(moving.teachers)
    }
    theirs, _ = world.reset(seed=4)
    ours, _ = focal.reset(seed=4)
    for _ in range(60):
        action = rng.uniform(focal.action_space.low, focal.action_space.high)
        actions = {name: policy.act(theirs[name]) for name, policy in policies.items()}
        theirs, rewards, *_ = world.step({**actions, "student": action})
        ours, reward, terminated, truncated, _ = focal.step(action)
        assert all(np.array_equal(ours[sense], theirs["student"][sense]) for sense in ours)
        assert reward == rewards["student"]
        assert not terminated
        assert not truncated
    assert np.abs(world.backend.state("teacher_0")[1]).max() > 0.2  # the teachers did move
    world.close()
    focal.close()


def test_an_episode_begins_anew_for_the_teachers_too(moving: Scenario) -> None:
    focal = testbed.focal_env(moving, images=False)
    rest, joints = np.zeros(3, np.float32), []
    for _ in range(2):
        focal.reset(seed=1)
        for _ in range(30):
            focal.step(rest)
        joints.append(focal.world.backend.state("teacher_0")[1])
    assert np.array_equal(*joints)
    assert np.abs(joints[0]).max() > 0.1
    focal.close()


def test_an_action_is_held_and_rewards_add_up(scenario: Scenario) -> None:
    single = testbed.focal_env(scenario, images=False)
    held = testbed.focal_env(scenario, images=False, hold=6, max_cycles=20)
    single.reset(seed=2)
    held.reset(seed=2)
    action = np.array([0.5, 1.2, 0.0], np.float32)
    steps = [single.step(action)[1] for _ in range(20)]
    lived = [held.step(action) for _ in range(4)]
    assert [step[1] for step in lived] == pytest.approx([sum(steps[i : i + 6]) for i in (0, 6, 12, 18)])
    assert [step[3] for step in lived] == [False, False, False, True]  # the last was held for two steps only
    assert held.metadata["render_fps"] == 10
    with pytest.raises(ValueError, match="at least one control step"):
        FocalWorld(single.world, hold=0)
    single.close()
    held.close()


def test_without_images_no_picture_is_taken(scenario: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    focal = testbed.focal_env(scenario, images=False)
    monkeypatch.setattr(focal.world.backend, "look", lambda: pytest.fail("a picture was taken"))
    observation, _ = focal.reset(seed=0)
    observation, *_ = focal.step(focal.action_space.sample())
    assert set(observation) == {"tilt", "joints"}
    focal.close()


def test_pettingzoos_registry_and_wrappers_take_the_world(scenario: Scenario) -> None:
    testbed.register()
    testbed.register()  # harmless when repeated
    made = pettingzoo.make("parallel", "testbed/whom_to_imitate-v0", scenario=scenario, images=False)
    wrapped = BaseParallelWrapper(made)
    observations, _ = wrapped.reset(seed=1)
    assert set(observations) == {"student", "teacher_0", "teacher_1"}
    wrapped.close()
    aec = pettingzoo.make("aec", "testbed/whom_to_imitate-v0", scenario=scenario, images=False)
    back = aec_to_parallel(OrderEnforcingWrapper(ClipOutOfBoundsWrapper(aec)))
    back.reset(seed=1)
    wild = {agent: 1e3 * np.ones(back.action_space(agent).shape, np.float32) for agent in back.agents}
    observations, *_ = back.step(wild)
    assert observations["student"]["joints"] == pytest.approx(np.full(2, np.pi / 2))
    back.close()
