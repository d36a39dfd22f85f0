"""A trial's twin: the same commands, step by step, given to the simulated bodies.

Where the bench and the simulation differ, a student soon does other things there than here. The twin takes that away:
whatever was commanded on the bench is commanded in the simulation, so that what differs is the bodies.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from testbed.experiment.jobs import Job
from testbed.experiment.trial import seeds_of
from testbed.frames import tilt_of
from testbed.scenario import Scenario, drawn, in_cell
from testbed.world.bullet import SimulatedBackend
from testbed.world.env import World
from testbed.world.focal import FocalWorld
from testbed.world.placement import STUDENT

Array = NDArray[Any]


class Twin(NamedTuple):
    """What the simulated student does under a trial's actions.

    Attributes:
        base: (t + 1, 7) position and quaternion xyzw of its main body, at the start and after each action.
        tilt: (t + 1, 2) rad, without the sensor's noise.
    """

    base: Array
    tilt: Array


def twin_of(scenario: Scenario, job: Job, actions: Array) -> Twin:
    """Live through a trial's actions in the simulation.

    Args:
        scenario: The run's scenario.
        job: Which trial of it.
        actions: (t, n + 1) the student's joint targets and pan, rad.
    """
    here = drawn(in_cell(scenario, job.cell), job.trial)
    seed, _ = seeds_of(scenario, job.trial)
    backend = SimulatedBackend(here)
    focal = FocalWorld(World(here, backend=backend, images=False, max_cycles=len(actions) + 1))
    try:
        focal.reset(seed=seed)
        bases = [backend.state(STUDENT)[0]]
        for action in actions:
            focal.step(action)
            bases.append(backend.state(STUDENT)[0])
    finally:
        focal.close()
    return Twin(np.array(bases), np.array([tilt_of(base[3:]) for base in bases]))


def rests(commands: Array, actions: Array) -> list[int | None]:
    """The step at whose end each command had been held longest, in the order of the commands.

    Args:
        commands: (k, n) the commands of self-discovery, rad.
        actions: (t, n + 1) everything that the student did, rad.

    Returns:
        (k,) indices into states after actions (state s is that after action s - 1); None for a command that the
        actions do not have.
    """
    joints = actions[:, : commands.shape[1]]
    turns = np.flatnonzero(np.any(np.diff(joints, axis=0) != 0, axis=1)) + 1
    ends = [*turns, len(joints)]
    found: list[int | None] = []
    place = 0
    for command in commands:
        meant = [
            number
            for number in range(place, len(ends))
            if np.allclose(joints[ends[number] - 1], command, atol=1e-5)
        ]
        found.append(int(ends[meant[0]]) if meant else None)
        place = meant[0] + 1 if meant else place
    return found
