"""What the student tries out in its mind: where a self-model settles, and where a controller takes it."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.bodies import bare_bullet
from benchmarks.bodies.in_mujoco import MuJoCoBody, up_of
from benchmarks.eyes import MissingError
from benchmarks.measure import Seconds, Settings, interleaved
from benchmarks.row import Row, faster, left_out, measured
from testbed.bodies.morphology import Morphology, Vector, load_robot
from testbed.student.body.imagination import Imagination, Rehearsal
from testbed.student.body.self_discovery import random_genome
from testbed.student.body.self_model import BodyPrior, self_model
from testbed.student.body.servos import Servos
from testbed.student.body.settling import Settler, up_of_tilt
from testbed.student.parameters import ImaginationParameters, SelfDiscoveryParameters

BARE, MUJOCO = "bare PyBullet loop", "MuJoCo"
MOST_OVER_BARE = 1.1
QUASI_STATIC = 50.0
MEDIAN_DEG, WITHIN_DEG, SHARE_WITHIN = 0.1, 5.0, 0.95
OFTENER = 5
"""Turns are short, and the machine wavers by a fifth from one to the next, which is twice what is to be told apart."""
BODIES, COMMANDS = 8, 10
AGREEING = 150  # bodies, for how well the quasi-static solver agrees
MOTION, CONTROL_STEP = 240, 1 / 60
SETTLED = f"self-model evaluation, {COMMANDS} settled commands"
CONTROLLED = f"controller evaluation, {MOTION} steps"
PAPER = SelfDiscoveryParameters()
STEP = ImaginationParameters().physics_step
SUBSTEPS = round(CONTROL_STEP / STEP)
SERVOS = Servos(CONTROL_STEP, STEP)
LOOKS = round(PAPER.settle_time / STEP / 12)


def rows(settings: Settings) -> Iterator[Row]:
    """Self-models that settle, and one that follows a controller."""
    with (
        tempfile.TemporaryDirectory() as folder,
        Imagination(ImaginationParameters(), CONTROL_STEP) as imagination,
    ):
        yield from settling(settings, Path(folder), imagination)
        yield from moving(settings, Path(folder), imagination)


def settling(settings: Settings, folder: Path, imagination: Imagination) -> Iterator[Row]:
    """Another self-model at each call: it is loaded, settles ten times and is thrown away."""
    bodies, commands = self_models(BODIES)
    files = [bare_bullet.OnDisk.of(body, folder / str(i)) for i, body in enumerate(bodies)]
    client = bare_bullet.new_world(STEP)
    rest: dict[str, Any] = {"looks": LOOKS, "rest_speed": PAPER.rest_speed}

    def ours(i: int) -> Vector:
        return imagination.settle(
            bodies[i], commands[i], limit=PAPER.settle_time, rest_speed=PAPER.rest_speed
        )

    def bare(i: int) -> Vector:
        return bare_bullet.settle(client, files[i], commands[i], **rest)

    def solved(i: int) -> Vector:
        return Settler(bodies[i]).tilt(commands[i])

    for i in range(3):  # the same physics, so that the same number of steps is compared
        turned = Rotation.from_quat(bare(i)).as_matrix()[:, 2]
        assert np.allclose(turned, up_of_tilt(ours(i)), atol=1e-12), "the bare loop settles elsewhere"
    calls: dict[str, Callable[[int], object]] = {"ours": ours, BARE: bare, "solver": solved}
    missing = ""
    try:
        there = [
            MuJoCoBody(body, STEP).settle(asked, **rest) for body, asked in zip(bodies, commands, strict=True)
        ]
        ups = [up_of_tilt(ours(i)) for i in range(BODIES)]
        alike = np.concatenate([apart_deg(up, up_of(turn)) for up, turn in zip(ups, there, strict=True)])
        calls[MUJOCO] = lambda i: MuJoCoBody(bodies[i], STEP).settle(commands[i], **rest)
    except MissingError as why:
        missing = str(why)
    times = by_body(calls, settings)
    yield faster(SETTLED, BARE, times[BARE], times["ours"], 1 / MOST_OVER_BARE, note="simulated by PyBullet")
    if missing:
        yield left_out(SETTLED, MUJOCO, missing)
    else:
        rests = f"{np.mean(alike <= WITHIN_DEG):.0%} of its rests are within {WITHIN_DEG:g} deg of PyBullet's"
        yield faster(SETTLED, MUJOCO, times[MUJOCO], times["ours"], note=f"simulated by PyBullet; {rests}")
    name = f"{SETTLED}, quasi-static"
    for peer in (BARE, MUJOCO):
        if peer in times:
            yield faster(name, peer, times[peer], times["solver"], QUASI_STATIC if peer == BARE else None)
    yield from agreement(imagination)


def agreement(imagination: Imagination) -> Iterator[Row]:
    """How far the quasi-static solver's rest is from the simulated one, over random bodies and commands."""
    bodies, commands = self_models(AGREEING, seed=1)
    away = []
    for body, asked in zip(bodies, commands, strict=True):
        felt = imagination.settle(body, asked, limit=4 * PAPER.settle_time, rest_speed=PAPER.rest_speed / 4)
        away.append(apart_deg(up_of_tilt(felt), up_of_tilt(Settler(body).tilt(asked))))
    yield from agreeing(f"{SETTLED}, quasi-static", np.array(away), f"{AGREEING} bodies of 3 parts")


def agreeing(name: str, away: Vector, note: str, *, to_reach: bool = True) -> Iterator[Row]:
    """Two rows from angles (bodies, poses), degrees; the interval is over bodies. Not all have something to reach."""
    pick = np.random.default_rng(0).integers(0, len(away), (1000, len(away)))
    again = away[pick].reshape(len(pick), -1)
    for what, unit, target, middle, many in (
        ("median", "deg", MEDIAN_DEG, np.median(away), np.median(again, axis=1)),
        (
            "share within 5 deg",
            "of 1",
            SHARE_WITHIN,
            np.mean(away <= WITHIN_DEG),
            np.mean(again <= WITHIN_DEG, axis=1),
        ),
    ):
        low, high = np.quantile(many, (0.025, 0.975))
        figure = (float(middle), float(low), float(high))
        sense: Any = "at most" if unit == "deg" else "at least"
        aim = target if to_reach else None
        yield measured(f"{name}: {what}", unit, figure, aim, sense, peer="simulated by PyBullet", note=note)


def moving(settings: Settings, folder: Path, imagination: Imagination) -> Iterator[Row]:
    """The paper's body under one controller after another, flat at the start of each."""
    body = load_robot("crawler")
    motions = gaits(body, BODIES)
    file = bare_bullet.OnDisk.of(body, folder / "crawler")
    client = bare_bullet.new_world(STEP)
    robot = bare_bullet.load(client, file)
    solver = Settler(body)
    with imagination.imagine(body) as rehearsal:
        calls: dict[str, Callable[[int], object]] = {
            "ours": lambda i: rehearsal.move(motions[i]),
            BARE: lambda i: bare_bullet.move(client, robot, file, motions[i], SUBSTEPS),
            "solver": lambda i: solver.follow(motions[i], SERVOS),
        }
        same = bare_bullet.move(client, robot, file, motions[0], SUBSTEPS)
        assert np.array_equal(same, rehearsal.move(motions[0])[0]), "the bare loop moves elsewhere"
        try:
            there = MuJoCoBody(body, STEP)
            calls[MUJOCO] = lambda i: there.move(motions[i], SUBSTEPS)
        except MissingError as why:
            yield left_out(CONTROLLED, MUJOCO, str(why))
        times = by_body(calls, settings)
        yield faster(
            CONTROLLED, BARE, times[BARE], times["ours"], 1 / MOST_OVER_BARE, note="simulated by PyBullet"
        )
        if MUJOCO in times:
            yield faster(CONTROLLED, MUJOCO, times[MUJOCO], times["ours"], note="simulated by PyBullet")
        name = f"{CONTROLLED}, quasi-static"
        for peer in (BARE, MUJOCO):
            if peer in times:
                yield faster(name, peer, times[peer], times["solver"], QUASI_STATIC if peer == BARE else None)
        crawls = gaits(body, 2 * BODIES, seed=1)
        away = np.array([off_course(rehearsal, solver, motion, SERVOS) for motion in crawls])
        yield from agreeing(name, away, "random gaits with a period of 1.5 to 3 s; every step")
        at_once = np.array([off_course(rehearsal, solver, motion, None) for motion in crawls])
        yield from agreeing(f"{name}, motors that arrive at once", at_once, "the same gaits", to_reach=False)
    strangers = []
    for i, stranger in enumerate(self_models(AGREEING, seed=1)[0]):
        (motion,) = gaits(stranger, 1, seed=i)
        with imagination.imagine(stranger) as rehearsal:
            strangers.append(off_course(rehearsal, Settler(stranger), motion, SERVOS))
    note = f"{AGREEING} bodies of 3 parts, a random gait each; every step"
    yield from agreeing(f"{name}, random self-models", np.array(strangers), note, to_reach=False)


def off_course(rehearsal: Rehearsal, solver: Settler, motion: Vector, servos: Servos | None) -> Vector:
    """(steps,) degrees between the simulated and the solved tilt of a body that follows (steps, joints) rad."""
    ways = (rehearsal.move(motion), solver.follow(motion, servos))
    ups = (Rotation.from_quat(bases[:, 3:]).as_matrix()[:, 2] for bases, _ in ways)
    return apart_deg(*ups)


def self_models(count: int, seed: int = 0) -> tuple[list[Morphology], Vector]:
    """Random self-models of the paper's body, and (count, 10, joints) commands for each, rad."""
    rng, prior = np.random.default_rng(seed), BodyPrior.of(load_robot("crawler"))
    bodies = [self_model(prior, random_genome(len(prior.limbs), rng)) for _ in range(count)]
    low, high = prior.limits.T
    return bodies, rng.uniform(low, high, (count, COMMANDS, len(low)))


def gaits(body: Morphology, count: int, seed: int = 0) -> Vector:
    """(count, steps, joints) sinusoids as teachers move, rad."""
    rng, joints = np.random.default_rng(seed), len(body.joints)
    times = np.arange(MOTION) * CONTROL_STEP
    made = np.empty((count, MOTION, joints))
    for motion in made:
        period = rng.uniform(1.5, 3.0)
        centre, amplitude = np.radians(rng.uniform(0, 60, joints)), np.radians(rng.uniform(15, 35, joints))
        phase = rng.uniform(0, math.tau, joints)
        motion[:] = centre + amplitude * np.sin(math.tau * times[:, None] / period + phase)
    low, high = body.limits.T
    return np.clip(made, low, high)


def apart_deg(one: Vector, other: Vector) -> Vector:
    """(n,) degrees between unit vectors (n, 3)."""
    sine, cosine = np.linalg.norm(np.cross(one, other), axis=1), np.sum(one * other, axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, cosine)))


def by_body(calls: dict[str, Callable[[int], object]], settings: Settings) -> dict[str, Seconds]:
    """Seconds a body; in a turn everybody does the same ones."""
    turns = {name: through(call, BODIES) for name, call in calls.items()}
    return {name: seconds / BODIES for name, seconds in interleaved(turns, OFTENER * settings.rounds).items()}


def through(call: Callable[[int], object], count: int) -> Callable[[], object]:
    """One after the other: everybody has the same to do in a turn."""

    def turn() -> None:
        for i in range(count):
            call(i)

    return turn
