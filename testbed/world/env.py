"""The world as a PettingZoo environment: one student, its teachers, and the one door between them.

The parallel API is the core; ``testbed.env`` is the AEC form by PettingZoo's own conversion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from testbed.scenario import Scenario, drawn
from testbed.world.backend import Backend
from testbed.world.bullet import IMAGE, SimulatedBackend
from testbed.world.placement import STUDENT, placements
from testbed.world.viewer import Viewer

Observation = dict[str, NDArray[Any]]

_OVERVIEW = (480, 320)
FASTEST = 100.0
"""rad/s: faster movements of the student look like this one."""


class World(ParallelEnv[str, Observation, NDArray[np.floating[Any]]]):  # type: ignore[misc]
    """A student among its teachers.

    Agents: ``student``, ``teacher_0`` ... ``teacher_n``, all acting at every step.

    Actions are flat boxes: joint targets (rad) in the order of the body's joints; the student's ends with the pan
    of its rig (rad, positive to the right). Targets beyond the limits are clipped.

    Observations are dicts. ``tilt`` (2,) rad, to the side and nose-down, with the sensor's noise; ``joints`` (n,) rad
    as commanded. The student also sees ``left`` and ``right``, (75, 100) uint8 luminosity. A teacher also feels
    ``gaze`` (1,) rad: how far the rig's axis passes it by, and ``movement`` (1,) rad/s: how fast the student's fastest
    limb turns.

    Rewards are for learning clients: the metres that a robot came along its starting direction in this step. The
    students of this project do not use them.

    An episode never terminates and is truncated after ``max_cycles`` steps. The same seed gives the
    same episode, bit for bit.

    Args:
        scenario: Who stands where. What it leaves to chance is drawn as for its first trial.
        render_mode: None, ``rgb_array`` or ``human`` (a window; needs a display).
        backend: The simulated world if not given.
        max_cycles: Control steps in an episode; the scenario's own number if not given.
        images: Whether the student sees; without ``left`` and ``right`` no picture is taken, which is much faster.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        render_mode: str | None = None,
        backend: Backend | None = None,
        max_cycles: int | None = None,
        images: bool = True,
    ) -> None:
        self.scenario = scenario = drawn(scenario, 0)
        self.render_mode = render_mode
        self._images = images
        self.looking = True
        """Whether pictures are wanted; while they are not, those of the simulation are white and cost nothing."""
        self._max_cycles = max_cycles or scenario.world.max_cycles
        self.metadata: dict[str, Any] = {
            "name": "whom_to_imitate_v0",
            "render_modes": ["rgb_array", "human"],
            "is_parallelizable": True,
            "render_fps": round(1 / scenario.world.control_step),
        }
        self.backend = backend or SimulatedBackend(scenario)
        self._viewer = Viewer(scenario.name) if render_mode == "human" else None
        self.possible_agents = list(self.backend.robots)
        self.agents: list[str] = []
        self._bearings = {
            name: spot.bearing for name, spot in placements(scenario, self.backend.robots).items()
        }
        self._seeds = np.random.SeedSequence(scenario.seed)
        self._actions = {name: self._action_space(name) for name in self.possible_agents}
        # As float64: what is compared with it is not converted at every step.
        self._ranges = {
            name: (space.low.astype(float), space.high.astype(float)) for name, space in self._actions.items()
        }
        self._observations = {name: self._observation_space(name) for name in self.possible_agents}

    def observation_space(self, agent: str) -> spaces.Dict:
        """The same object at every call."""
        return self._observations[agent]

    def action_space(self, agent: str) -> spaces.Box:
        """The same object at every call."""
        return self._actions[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin an episode; without a seed the next one of the current sequence."""
        if seed is not None:
            self._seeds = np.random.SeedSequence(seed)
        self.backend.reset(self._seeds.spawn(1)[0])
        self.agents = list(self.possible_agents)
        self._cycle = 0
        self._commands = {name: body.rest for name, body in self.backend.robots.items()}
        self._progress = dict.fromkeys(self.agents, 0.0)
        return self._observe(), {name: {} for name in self.agents}

    def step(
        self, actions: Mapping[str, NDArray[np.floating[Any]]]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Let one control step pass; see :class:`World` for actions, observations and rewards."""
        if not self.agents:
            return {}, {}, {}, {}, {}
        pan = self.backend.pan
        for name in self.agents:
            low, high = self._ranges[name]
            action = np.minimum(np.maximum(actions[name], low), high)  # np.clip takes longer
            if name == STUDENT:
                action, pan = action[:-1], float(action[-1])
            self._commands[name] = action
        self.backend.apply(self._commands, pan)
        self._cycle += 1
        over = self._cycle >= self._max_cycles
        acting = self.agents
        rewards = {name: self._advance(name) for name in acting}
        observations = self._observe()
        self.agents = [] if over else acting
        return (
            observations,
            rewards,
            dict.fromkeys(acting, False),
            dict.fromkeys(acting, over),
            {name: {} for name in acting},
        )

    def render(self) -> NDArray[np.uint8] | None:
        """An overview as (320, 480, 3) uint8; in mode ``human`` the window shows it and None is returned."""
        if self.render_mode is None:
            return None
        picture = self.backend.picture(*_OVERVIEW)
        if self._viewer is None:
            return picture
        self._viewer.show(picture)
        return None

    def state(self) -> NDArray[np.floating[Any]]:
        """Every agent's tilt and commanded joints in one vector, for centralised critics (no truth)."""
        return np.concatenate(
            [np.concatenate([self._last[name]["tilt"], self._last[name]["joints"]]) for name in self._last]
        )

    def close(self) -> None:
        """Let go of the backend and the window."""
        if self._viewer is not None:
            self._viewer.close()
        self.backend.close()

    def _advance(self, name: str) -> float:
        before, self._progress[name] = self._progress[name], self.backend.progress(name)
        return self._progress[name] - before

    def _observe(self) -> dict[str, Observation]:
        pan, movement = self.backend.pan, min(self.backend.movement(STUDENT), FASTEST)
        observations: dict[str, Observation] = {}
        for name in self.agents:
            observations[name] = own = {
                "tilt": self.backend.tilt(name).astype(np.float32),
                "joints": self._commands[name].astype(np.float32),
            }
            if name != STUDENT:
                passing = math.remainder(pan - self._bearings[name], 2 * math.pi)
                own["gaze"] = np.array((passing,), np.float32)
                own["movement"] = np.array((movement,), np.float32)
            elif self._images:
                left, right = self.backend.look(self.looking)
                own["left"], own["right"] = left.copy(), right.copy()
        self._last = observations
        return observations

    def _action_space(self, name: str) -> spaces.Box:
        low, high = self.backend.robots[name].limits.T
        if name == STUDENT:
            pan = math.radians(self.scenario.rig.pan_limit_deg)
            low, high = np.append(low, -pan), np.append(high, pan)
        return spaces.Box(low.astype(np.float32), high.astype(np.float32))

    def _observation_space(self, name: str) -> spaces.Dict:
        low, high = self.backend.robots[name].limits.T.astype(np.float32)
        senses: dict[str, spaces.Space[Any]] = {
            # A sensor's noise can carry a reading past a half turn.
            "tilt": spaces.Box(-2 * math.pi, 2 * math.pi, (2,), np.float32),
            "joints": spaces.Box(low, high),
        }
        if name == STUDENT and self._images:
            senses |= {side: spaces.Box(0, 255, IMAGE, np.uint8) for side in ("left", "right")}
        elif name != STUDENT:
            senses["gaze"] = spaces.Box(-math.pi, math.pi, (1,), np.float32)
            senses["movement"] = spaces.Box(0, FASTEST, (1,), np.float32)
        return spaces.Dict(senses)
