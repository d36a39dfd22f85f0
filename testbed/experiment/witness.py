"""Keeps the truth about everybody while a student lives, for what is asked afterwards; and for baselines, at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.experiment import truth
from testbed.morphology import Vector
from testbed.scenario import Scenario
from testbed.student.insider import Insider
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
    """

    def __init__(self, scenario: Scenario, backend: SimulatedBackend) -> None:
        self._scenario, self._backend = scenario, backend
        self._states: dict[str, list[tuple[Vector, Vector]]] = {name: [] for name in backend.robots}
        self._exposed: list[int] = []
        self._pans: list[float] = []
        self._actions: list[Vector] = []

    def note(self, action: Vector | None = None) -> None:
        """Write down how everybody is now, and what the student did to come there."""
        for name, states in self._states.items():
            states.append(self._backend.state(name))
        self._exposed.append(self._backend.exposed)
        self._pans.append(self._backend.pan)
        if action is not None:
            self._actions.append(np.array(action))

    def log(self) -> Arrays:
        """The truth about everybody at the start and after each step; see :mod:`testbed.experiment.trial_report`."""
        log: Arrays = {
            "time/control_step": np.array(self._scenario.world.control_step),
            "time/exposed": np.array(self._exposed),
            "truth/pan": np.array(self._pans),
            f"truth/{STUDENT}/actions": np.array(self._actions),
        }
        for name, states in self._states.items():
            log[f"truth/{name}/base"] = np.array([base for base, _ in states])
            log[f"truth/{name}/joints"] = np.array([joints for _, joints in states])
        return log

    def insider(self) -> Insider | None:
        """For baselines that need it; None if nobody in the scenario is one."""
        if not any(mind.phases.privileged for mind in self._scenario.minds):
            return None
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
            base, joints = self._states[name][shown]
            parts.append(
                truth.parts_in_view(
                    body, base, joints, eye_height=self._scenario.rig.height, pan=self._pans[shown]
                )
            )
        return np.array(parts)[:, truth.in_motor_order(body)]
