"""A trial lived once more: the same world, the same chances, the same actions, and so the same observations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from testbed.errors import UserError, shown_path
from testbed.experiment.backends import SIMULATION, backend_of
from testbed.experiment.jobs import Job
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.trial import seeds_of
from testbed.experiment.trial_files import DamagedError, decode
from testbed.scenario import drawn, in_cell
from testbed.world.bullet import SimulatedBackend
from testbed.world.env import World
from testbed.world.focal import FocalWorld
from testbed.world.placement import STUDENT

Arrays = Mapping[str, NDArray[Any]]

ACTIONS = f"truth/{STUDENT}/actions"


class Episode(NamedTuple):
    """What the student saw, did and gained.

    Attributes:
        observations: By sense: (t + 1, ...), from the reset on; see :class:`testbed.world.env.World`.
        actions: (t, n + 1) joint targets and pan, rad.
        rewards: (t,) m.
        observation_space: Of one observation.
        action_space: Of one action.
        seed: With which the world was reset.
    """

    observations: dict[str, NDArray[Any]]
    actions: NDArray[Any]
    rewards: NDArray[np.float64]
    observation_space: spaces.Dict
    action_space: spaces.Box
    seed: int


def relive(run: RunDirectory, job: Job, *, images: bool = True) -> Episode:
    """Live a finished trial again, with the student's recorded actions in place of its thoughts.

    Args:
        run: The run.
        job: Which trial.
        images: Whether the student's images are taken; without them it is much faster.

    Raises:
        UserError: If the run was on a bench, the trial is damaged, was computed before actions were recorded, or does
            not come out as it did.
    """
    if backend_of(run) != SIMULATION:
        what = f"{shown_path(run.path)} was lived on a bench, which cannot be lived again"
        raise UserError(what, "`testbed replay` feeds its journal to the student; relive a run in simulation")
    recorded = _recorded(run, job)
    seed, _ = seeds_of(run.scenario, job.trial)
    here = drawn(in_cell(run.scenario, job.cell), job.trial)
    backend = SimulatedBackend(here)
    world = World(here, backend=backend, images=images)
    focal = FocalWorld(world)
    try:
        seen = [focal.reset(seed=seed)[0]]
        rewards = []
        states = {name: [backend.state(name)] for name in backend.robots}
        for action in recorded[ACTIONS]:
            observation, reward, *_ = focal.step(action)
            seen.append(observation)
            rewards.append(reward)
            for name, lived in states.items():
                lived.append(backend.state(name))
    finally:
        focal.close()
    for name, lived in states.items():
        for place, kind in enumerate(("base", "joints")):
            if not np.array_equal(
                np.array([state[place] for state in lived]), recorded[f"truth/{name}/{kind}"]
            ):
                raise UserError(
                    f"{job} of {shown_path(run.path)} does not come out as it did: {name} moves otherwise",
                    "use the versions that provenance.json names, or compute the run anew",
                )
    return Episode(
        {sense: np.stack([each[sense] for each in seen]) for sense in seen[0]},
        recorded[ACTIONS],
        np.array(rewards),
        world.observation_space(STUDENT),
        world.action_space(STUDENT),
        seed,
    )


def _recorded(run: RunDirectory, job: Job) -> Arrays:
    stem = run.path / "trials" / job.cell / str(job.trial)
    try:
        contents = [stem.with_name(f"{stem.name}{ending}").read_bytes() for ending in (".npz", ".parquet")]
        arrays = decode(*contents).arrays
    except (OSError, DamagedError) as error:
        raise UserError(
            f"{job} of {shown_path(run.path)} cannot be read ({error})",
            "run the scenario again to compute it anew",
        ) from error
    if ACTIONS not in arrays:
        raise UserError(
            f"{job} of {shown_path(run.path)} was computed before actions were recorded",
            "compute the run anew with --out in another folder",
        )
    return arrays
