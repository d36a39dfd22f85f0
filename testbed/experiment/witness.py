"""Keeps the truth about everybody while a student lives, for what is asked afterwards; and for baselines, at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.bodies.morphology import Vector
from testbed.errors import UserError
from testbed.experiment import truth
from testbed.experiment.stage import Truth
from testbed.scenario import Scenario
from testbed.student.insider import Insider
from testbed.world.backend import Backend
from testbed.world.bullet import SimulatedBackend
from testbed.world.placement import STUDENT, teacher_names

Arrays = dict[str, NDArray[Any]]

BESIDE = math.radians(20)
"""Whoever is seen further than this from a teacher's place is nobody, or somebody else."""


class Witness:
    """What the student senses at its n-th action is the state with index n - 1.

    Args:
        scenario: The trial's own scenario.
        backend: The world that it watches.
        truth: Who knows how everybody really is; a simulated world itself if not given.
    """

    def __init__(self, scenario: Scenario, backend: Backend, truth: Truth | None = None) -> None:
        self._scenario, self._backend = scenario, backend
        self._truth = backend if truth is None and isinstance(backend, SimulatedBackend) else truth
        self._states: dict[str, list[tuple[Vector, Vector] | None]] = {name: [] for name in backend.robots}
        self._exposed: list[int] = []
        self._pans: list[float] = []
        self._actions: list[Vector] = []

    def note(self, action: Vector | None = None) -> None:
        """Write down how everybody is now, and what the student did to come there."""
        for name, states in self._states.items():
            states.append(None if self._truth is None else self._truth.state(name))
        self._exposed.append(self._backend.exposed)
        self._pans.append(self._backend.pan)
        if action is not None:
            self._actions.append(np.array(action))

    def log(self) -> Arrays:
        """The truth about everybody at the start and after each step; see :mod:`testbed.experiment.trial_report`.

        Where it is not known all through, as on a real bench, it is NaN all through.
        """
        log: Arrays = {
            "time/control_step": np.array(self._scenario.world.control_step),
            "time/exposed": np.array(self._exposed),
            "truth/pan": np.array(self._pans),
            f"truth/{STUDENT}/actions": np.array(self._actions),
        }
        for name, states in self._states.items():
            known = [state for state in states if state is not None]
            if len(known) < len(states):
                known = [self._unknown(name)] * len(states)
            log[f"truth/{name}/base"] = np.array([base for base, _ in known])
            log[f"truth/{name}/joints"] = np.array([joints for _, joints in known])
        return log

    def insider(self) -> Insider | None:
        """For baselines that need it; None if nobody in the scenario is one."""
        if not any(mind.phases.privileged for mind in self._scenario.minds):
            return None
        if self._truth is None:
            what = "a student that is told the truth needs a world in which somebody knows it"
            raise UserError(what, "use --backend simulation, or a student that is told nothing")
        return Insider(self._scenario.student.body(), self.parts_of)

    def parts_of(self, bearing: float, steps: tuple[int, ...]) -> Vector | None:
        """The true parts (F, n, 8) of the teacher nearest to a bearing (rad) in the frames of these action counts.

        Eq. 2 in the rig's frame, main body first and limbs in motor order; None if no teacher stands there.
        """
        gaps = [
            abs(math.remainder(bearing - math.radians(teacher.bearing_deg), math.tau))
            for teacher in self._scenario.teachers
        ]
        if not gaps or min(gaps) > BESIDE:
            return None
        name = teacher_names(self._scenario)[int(np.argmin(gaps))]
        body, parts = self._backend.robots[name], []
        for step in steps:
            shown = self._exposed[step - 1]
            state = self._states[name][shown]
            if state is None:
                return None
            base, joints = state
            parts.append(
                truth.parts_in_view(
                    body, base, joints, eye_height=self._scenario.rig.height, pan=self._pans[shown]
                )
            )
        return np.array(parts)[:, truth.in_motor_order(body)]

    def _unknown(self, name: str) -> tuple[Vector, Vector]:
        return np.full(7, math.nan), np.full(len(self._backend.robots[name].joints), math.nan)
