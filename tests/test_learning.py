"""The examples of docs/learning.md: each is short, runs for a few hundred steps, and is told in the page."""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest

import testbed
from testbed.scenario import Scenario

DOCS = Path(__file__).parents[1] / "docs"
EXAMPLES = sorted((DOCS / "examples").glob("*.py"))


def example(name: str, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The module, without its command line."""
    pytest.importorskip("torch")
    monkeypatch.syspath_prepend(str(DOCS / "examples"))
    return SimpleNamespace(**runpy.run_path(str(DOCS / "examples" / f"{name}.py")))


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_examples_are_short_and_in_the_documentation(file: Path) -> None:
    assert len(file.read_text().splitlines()) < 80
    docstring = ast.get_docstring(ast.parse(file.read_text()))
    assert docstring is not None
    assert f"python docs/examples/{file.name}" in docstring
    assert f"examples/{file.name}" in (DOCS / "learning.md").read_text()


def test_ppo_runs_and_a_seed_repeats_it(monkeypatch: pytest.MonkeyPatch) -> None:
    ppo = example("ppo", monkeypatch)
    first = ppo.train(200, seed=3, batch=100)
    assert len(first) == 2
    assert np.isfinite(first).all()
    assert ppo.train(100, seed=3, batch=100) == first[:1]
    assert ppo.train(100, seed=4, batch=100) != first[:1]


def test_ppo_trains_among_teachers_too(scenario: Scenario, monkeypatch: pytest.MonkeyPatch) -> None:
    ppo = example("ppo", monkeypatch)
    assert len(ppo.train(100, scenario=scenario, batch=100)) == 1


def test_stable_baselines_trains_all_robots_through_supersuit(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("stable_baselines3")
    pytest.importorskip("supersuit")
    trained = example("stable_baselines", monkeypatch).train(192)
    assert trained.num_timesteps == 192  # 64 steps of three robots


def test_stable_baselines_trains_on_stereo_images(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("stable_baselines3")
    stereo = example("stable_baselines_stereo", monkeypatch)
    trained = stereo.train(55)
    assert trained.num_timesteps == 55
    assert "stereo" in trained.actor.features_extractor.extractors
    assert type(trained.actor.features_extractor.extractors["stereo"]).__name__ == "NatureCNN"


def as_boxes(world: Any) -> Any:
    """SuperSuit stacks and pads boxes only."""
    import supersuit

    space = gymnasium.spaces.Box(-7, 7, (4,), np.float32)
    return supersuit.observation_lambda_v0(
        world, lambda seen, *_: np.concatenate([seen["tilt"], seen["joints"]]), lambda *_: space
    )


SUPERSUIT: dict[str, tuple[Any, ...]] = {
    "clip_reward_v0": (),
    "scale_actions_v0": (0.5,),
    "sticky_actions_v0": (0.2,),
    "pad_action_space_v0": (),
}
SUPERSUIT_BOXES: dict[str, tuple[Any, ...]] = {
    "frame_stack_v1": (2,),
    "agent_indicator_v0": (),
    "delay_observations_v0": (2,),
    "black_death_v3": (),
    "normalize_obs_v0": (),
}


@pytest.mark.parametrize("name", [*SUPERSUIT, *SUPERSUIT_BOXES])
def test_supersuits_wrappers_take_the_world(scenario: Scenario, name: str) -> None:
    supersuit = pytest.importorskip("supersuit")
    world = testbed.parallel_env(scenario, images=False)
    world = getattr(supersuit, name)(
        as_boxes(world) if name in SUPERSUIT_BOXES else world, *{**SUPERSUIT, **SUPERSUIT_BOXES}[name]
    )
    world.reset(seed=1)
    for _ in range(5):
        observations, *_ = world.step({agent: world.action_space(agent).sample() for agent in world.agents})
    assert set(observations) == {"student", "teacher_0", "teacher_1"}
    world.close()


def test_random_actions_are_what_learning_is_measured_against(monkeypatch: pytest.MonkeyPatch) -> None:
    curve = example("learning_curve", monkeypatch)
    assert curve.at_random(0, episodes=1) == curve.at_random(0, episodes=1)
    mean, low, high = curve.mean_with_interval(np.array([1.0, 2.0, 4.0, 5.0, 8.0]))
    assert low < mean == 4.0 < high
    sys.modules.pop("ppo", None)
