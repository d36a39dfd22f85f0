"""How many control steps a second: the world against its bare physics, another world, and another renderer."""

from __future__ import annotations

import contextlib
import io
import itertools
import math
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

import testbed
from benchmarks.bodies import bare_bullet
from benchmarks.measure import Settings, interleaved
from benchmarks.row import Row, faster, left_out
from testbed.scenario import Scenario, load_scenario
from testbed.silence import silence
from testbed.world.bullet import SimulatedBackend, bodies_of
from testbed.world.env import World
from testbed.world.focal import FocalWorld
from testbed.world.gaits import scripted_policy
from testbed.world.placement import STUDENT, placements, teacher_names

with silence():  # importing it prints its build time
    import pybullet

BLIND, STEREO, PAIR, SHIPPED_PAIR = 0.7, 20.0, 20.0, 2.0  # targets
ACTIONS = 600
PERIOD = 120  # control steps of the gaits
IN_PYTHON = "the rest goes into what agents are given: observations, noise and rewards of three, in Python"
MAMUJOCO = "Gymnasium-Robotics MaMuJoCo, Ant 2x4"


def rows(settings: Settings) -> Iterator[Row]:
    """Steps without images, then with."""
    yield from blind(settings)
    yield from seeing(settings)


def blind(settings: Settings) -> Iterator[Row]:
    """The world of ``whom_to_imitate``, three robots that crawl, against the same bodies driven by hand."""
    scenario = load_scenario("whom_to_imitate")
    name = "world step without images"
    with tempfile.TemporaryDirectory() as folder:
        calls = {"ours": world_stepping(scenario), "bare": bare_stepping(scenario, Path(folder))}
        other = mamujoco()
        if other is not None:
            calls[MAMUJOCO] = other
        times = interleaved(calls, settings.rounds, turn=0.2)
    rate = f"{1 / np.median(times['ours']):,.0f} steps/s; a student and two teachers, all observations and rewards"
    yield faster(name, "raw PyBullet loop", times["bare"], times["ours"], BLIND, note=rate, why=IN_PYTHON)
    if MAMUJOCO in times:
        rate = f"{1 / np.median(times[MAMUJOCO]):,.0f} steps/s there: other bodies, five physics steps instead of four"
        yield faster(name, MAMUJOCO, times[MAMUJOCO], times["ours"], note=rate)
    else:
        yield left_out(name, MAMUJOCO, "gymnasium-robotics is not installed (pip install -e '.[bench]')")


def world_stepping(scenario: Scenario) -> Callable[[], object]:
    """One step of the PettingZoo world, everybody acting."""
    world = World(scenario, images=False, max_cycles=10**9)
    world.reset(seed=7)
    endless = itertools.cycle(commands(scenario))
    return lambda: world.step(next(endless))


def commands(scenario: Scenario) -> list[dict[str, np.ndarray]]:
    """What everybody does in each control step: the teachers their gaits, the student the first teacher's."""
    bodies, control_step = bodies_of(scenario), scenario.world.control_step
    policies: dict[str, Any] = {
        name: scripted_policy(teacher.gait, bodies[name], control_step)
        for name, teacher in zip(teacher_names(scenario), scenario.teachers, strict=True)
    }
    nothing = {"tilt": np.zeros(2), "gaze": np.zeros(1), "movement": np.zeros(1)}
    made = []
    for _ in range(PERIOD):
        actions = {name: np.asarray(policy.act(nothing)) for name, policy in policies.items()}
        made.append({STUDENT: np.append(actions["teacher_0"], 0.0), **actions})
    return made


def bare_stepping(scenario: Scenario, folder: Path) -> Callable[[], object]:
    """The same bodies at the same places, driven by PyBullet calls alone; poses and joints are read."""
    world, bodies = scenario.world, bodies_of(scenario)
    client = bare_bullet.new_world(world.physics_step)
    spots = placements(scenario, bodies)
    robots = []
    for name, body in bodies.items():
        file = bare_bullet.OnDisk.of(body, folder / name)
        robots.append((bare_bullet.load(client, file, spots[name].place, spots[name].yaw), file, name))
    endless = itertools.cycle(commands(scenario))

    def step() -> None:
        actions = next(endless)
        for robot, file, name in robots:
            bare_bullet.drive(client, robot, file, actions[name][: len(file.torques)])
        for _ in range(world.physics_steps):
            pybullet.stepSimulation(physicsClientId=client)
        for robot, file, _ in robots:
            pybullet.getBasePositionAndOrientation(robot, physicsClientId=client)
            pybullet.getJointStates(robot, range(len(file.torques)), physicsClientId=client)

    return step


def mamujoco() -> Callable[[], object] | None:
    """A step of another world of many agents; None where it is not installed."""
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            from gymnasium_robotics import mamujoco_v1  # prints which of its other worlds were changed
    except ImportError:
        return None
    world = mamujoco_v1.parallel_env("Ant", "2x4")
    world.reset(seed=7)
    rng = np.random.default_rng(7)
    drawn = [
        {name: rng.uniform(-0.5, 0.5, world.action_space(name).shape) for name in world.possible_agents}
        for _ in range(ACTIONS)
    ]
    endless = itertools.cycle(drawn)

    def step() -> None:
        world.step(next(endless))
        if not world.agents:
            world.reset(seed=7)

    return step


def seeing(settings: Settings) -> Iterator[Row]:
    """A new stereo pair at every step, analytic, against TinyRenderer with Bullet's own ground drawn."""
    ours, theirs = watching("analytic"), watching("tinyrenderer")
    unseen = watching("tinyrenderer")
    draw_ground(theirs)
    peer, own = "TinyRenderer, ground drawn", "TinyRenderer as shipped"
    try:
        pairs = {
            "ours": backend_of(ours)._expose_pair,
            peer: backend_of(theirs)._expose_pair,
            own: backend_of(unseen)._expose_pair,
        }
        steps = {"ours": stepping(ours), peer: stepping(theirs), own: stepping(unseen)}
        for name, calls, target, shipped in (
            ("stereo pair", pairs, PAIR, SHIPPED_PAIR),
            ("world step with stereo", steps, STEREO, None),
        ):
            times = interleaved(calls, settings.rounds, turn=0.1)
            rate = f"{1 / np.median(times['ours']):,.0f} a second; a student and one teacher"
            yield faster(f"{name}, analytic", peer, times[peer], times["ours"], target, note=rate)
            yield faster(f"{name}, analytic", own, times[own], times["ours"])
            yield faster(f"{name}, {own}", peer, times[peer], times[own], shipped)
    finally:
        for world in (ours, theirs, unseen):
            world.close()


def watching(renderer: Literal["analytic", "tinyrenderer"]) -> FocalWorld:
    """A student that watches one teacher crawl."""
    scenario: Scenario = load_scenario("whom_to_imitate")
    rig = scenario.rig.model_copy(update={"renderer": renderer, "camera_rate": 60.0})
    fewer = scenario.model_copy(update={"rig": rig, "teachers": scenario.teachers[:1]})
    world = testbed.focal_env(fewer, max_cycles=10**9)
    world.reset(seed=1)
    for _ in range(60):
        world.step(_at_the_teacher())
    return world


def backend_of(world: FocalWorld) -> SimulatedBackend:
    assert isinstance(world.world.backend, SimulatedBackend)
    return world.world.backend


def stepping(world: FocalWorld) -> Callable[[], object]:
    action = _at_the_teacher()
    return lambda: world.step(action)


def _at_the_teacher() -> np.ndarray:
    return np.array([0.0, 0.0, math.radians(-30)], np.float32)


def draw_ground(world: FocalWorld) -> None:
    """Bullet's chequered plane, which nobody touches."""
    client = backend_of(world)._simulation.client
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
    ground = pybullet.createMultiBody(0, plane, physicsClientId=client)
    pybullet.setCollisionFilterGroupMask(ground, -1, 0, 0, physicsClientId=client)
