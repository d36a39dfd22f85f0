"""How fast does the world show itself? The analytic renderer against TinyRenderer with Bullet's own ground drawn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
import pybullet

import testbed
from benchmarks.measure import Row, against
from testbed.scenario import Scenario, load_scenario
from testbed.world.focal import FocalWorld

OBSERVATIONS, STEPS = 20.0, 20.0  # targets


def rows() -> list[Row]:
    """Every measurement of this file, as rows of benchmarks/results.json."""
    ours, theirs = world_of("analytic"), world_of("tinyrenderer")
    draw_ground(theirs)
    peer = "TinyRenderer, ground drawn"
    try:
        return [
            against(
                "stereo observations, analytic", peer, OBSERVATIONS, looking(ours), looking(theirs), turns=1
            ),
            against("the same, physics included", peer, STEPS, living(ours), living(theirs), turns=1),
        ]
    finally:
        ours.close()
        theirs.close()


def world_of(renderer: Literal["analytic", "tinyrenderer"]) -> FocalWorld:
    """A student that watches one teacher crawl, a new stereo pair at every step."""
    scenario: Scenario = load_scenario("whom_to_imitate")
    rig = scenario.rig.model_copy(update={"renderer": renderer, "camera_rate": 60.0})
    world = testbed.focal_env(scenario.model_copy(update={"rig": rig, "teachers": scenario.teachers[:1]}))
    world.reset(seed=1)
    for _ in range(60):
        world.step(at_the_teacher())
    return world


def at_the_teacher() -> np.ndarray:
    return np.array([0.0, 0.0, np.radians(-30)], np.float32)


def draw_ground(world: FocalWorld) -> None:
    """Bullet's chequered plane, which nobody touches."""
    client = world.world.backend._simulation.client
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
    ground = pybullet.createMultiBody(0, plane, physicsClientId=client)
    pybullet.setCollisionFilterGroupMask(ground, -1, 0, 0, physicsClientId=client)


def looking(world: FocalWorld) -> Callable[[], object]:
    return world.world.backend._expose_pair


def living(world: FocalWorld) -> Callable[[], object]:
    action = at_the_teacher()
    return lambda: world.step(action)
