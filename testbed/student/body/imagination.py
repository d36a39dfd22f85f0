"""Trying things out in the mind: the physical simulation of a self-model (Sections 3.2.2 and 3.4.2)."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Generator
from typing import Self

import numpy as np

from testbed.bodies.morphology import Morphology, Vector
from testbed.physics import PhysicsSpec, Simulation
from testbed.student.body.servos import Servos
from testbed.student.parameters import ImaginationParameters

_BODY = "self"

Enough = Callable[[int, Vector, Vector], bool]
"""A control step's number, bases (steps, 7) and joints (steps, joints) rad: whether to stop here."""


class Imagination:
    """A simulation of its own in which the student lets self-models act. A context manager.

    Args:
        believed: The physics that the student believes in.
        control_step: Seconds between two motor commands; a whole number of physics steps is fitted into it.
    """

    def __init__(self, believed: ImaginationParameters, control_step: float) -> None:
        self._substeps = max(1, round(control_step / believed.physics_step))
        self._step = control_step / self._substeps
        physics = PhysicsSpec(
            step=self._step, gravity=believed.gravity, ground_friction=believed.ground_friction
        )
        self._simulation = Simulation(physics)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._simulation.close()

    def settle(self, body: Morphology, commands: Vector, *, limit: float, rest_speed: float) -> Vector:
        """The tilt of a body's root after each command, started flat.

        Args:
            body: The body.
            commands: (n, joints) motor commands, rad.
            limit: Longest time to wait for rest, s.
            rest_speed: Slower than this (rad/s) is at rest.

        Returns:
            (n, 2) tilt, rad.
        """
        with contextlib.closing(self.rests(body, commands, limit=limit, rest_speed=rest_speed)) as rests:
            return np.array(list(rests)).reshape(-1, 2)

    def rests(
        self, body: Morphology, commands: Vector, *, limit: float, rest_speed: float
    ) -> Generator[Vector, None, None]:
        """The same one by one, so that whoever has seen enough may close it: yields (2,) tilts, rad."""
        patience = 12  # physics steps between two looks whether the body is at rest
        simulation = self._simulation
        simulation.add(_BODY, body)
        try:
            for command in commands:
                simulation.reset(_BODY)
                simulation.command(_BODY, command)
                for _ in range(max(1, round(limit / self._step / patience))):
                    simulation.step(patience)
                    if simulation.speed(_BODY) < rest_speed:
                        break
                yield simulation.tilt(_BODY)
        finally:
            simulation.remove(_BODY)

    def imagine(self, body: Morphology) -> Rehearsal:
        """Put a body into the mind to rehearse motions with; close it afterwards."""
        return Rehearsal(self._simulation, self._substeps, body)


class Rehearsal:
    """One body in the mind, flat at the start of each motion. A context manager."""

    def __init__(self, simulation: Simulation, substeps: int, body: Morphology) -> None:
        self._simulation, self._substeps, self._body = simulation, substeps, body
        simulation.add(_BODY, body)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._simulation.remove(_BODY)

    @property
    def servos(self) -> Servos:
        """What moves the joints here."""
        step = self._simulation.spec.step
        return Servos(step * self._substeps, step)

    def move(
        self, targets: Vector, enough: Enough = lambda step, bases, joints: False
    ) -> tuple[Vector, Vector]:
        """Let the body follow motor commands, one a control step.

        Args:
            targets: (steps, joints) rad.
            enough: Asked after each control step, with its number and what is returned, filled up to there, whether
                the rest need not be seen; then the rest is NaN.

        Returns:
            After each step: base (steps, 7), position and quaternion of the root, and joints (steps, joints) rad.
        """
        self._simulation.reset(_BODY)
        bases, joints = np.full((len(targets), 7), np.nan), np.full_like(targets, np.nan)
        for step, (base, angles) in enumerate(self._simulation.follow(_BODY, targets, self._substeps)):
            bases[step], joints[step] = base, angles
            if enough(step, bases, joints):
                break
        return bases, joints
