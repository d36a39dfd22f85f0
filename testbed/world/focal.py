"""The world as one agent sees it: a Gymnasium environment of the student, its teachers played by their own policies.

So clients that know a single agent can train in it. The teachers act by the gaits of the scenario, through the same
``step`` and by the same observations as anybody else.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from testbed.world.env import Observation, World
from testbed.world.gaits import Policy, scripted_policy
from testbed.world.placement import STUDENT, teacher_names


class FocalWorld(gymnasium.Env[Any, Any]):
    """A world of which only the student's side is seen.

    Actions, observations and rewards are the student's, see :class:`testbed.world.env.World`. An episode never
    terminates and is truncated when the world's is.

    Args:
        world: Who is there.
        hold: For how many control steps an action is held; rewards add up. Fewer decisions are easier to learn.
    """

    def __init__(self, world: World, *, hold: int = 1) -> None:
        if hold < 1:
            raise ValueError(f"an action is held for at least one control step, not {hold}")
        self.world = world
        self._hold = hold
        self.observation_space = world.observation_space(STUDENT)
        self.action_space = world.action_space(STUDENT)
        self.render_mode = world.render_mode
        rate = max(1, round(world.metadata["render_fps"] / hold))
        self.metadata = {"render_modes": world.metadata["render_modes"], "render_fps": rate}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; see :meth:`World.reset`."""
        super().reset(seed=seed)
        scenario = self.world.scenario
        self._policies: dict[str, Policy] = {
            name: scripted_policy(teacher.gait, self.world.backend.robots[name], scenario.world.control_step)
            for name, teacher in zip(teacher_names(scenario), scenario.teachers, strict=True)
        }
        self._observations, infos = self.world.reset(seed=seed, options=options)
        return self._observations[STUDENT], infos[STUDENT]

    def step(
        self, action: NDArray[np.floating[Any]]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Let the student act, for ``hold`` control steps, or until the episode ends."""
        reward, over = 0.0, False
        for _ in range(self._hold):
            actions = {name: policy.act(self._observations[name]) for name, policy in self._policies.items()}
            self._observations, rewards, _, truncations, infos = self.world.step({**actions, STUDENT: action})
            reward += rewards[STUDENT]
            over = truncations[STUDENT]
            if over:
                break
        return self._observations[STUDENT], reward, False, over, infos[STUDENT]

    def render(self) -> Any:
        """See :meth:`World.render`."""
        return self.world.render()

    def close(self) -> None:
        """See :meth:`World.close`."""
        self.world.close()
