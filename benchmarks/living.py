"""How fast does the student live? Its phases and the world against their targets and a peer."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pybullet

from benchmarks.measure import Row, against, row
from testbed.experiment.trial import live, run_trial, senses_of, silent, student_of
from testbed.experiment.witness import Witness
from testbed.morphology import load_robot
from testbed.scenario import load_scenario, with_overrides
from testbed.student.body.imagination import Imagination
from testbed.student.body.self_discovery import evolve_self_model, random_commands
from testbed.student.body.self_model import BodyPrior
from testbed.student.mind import Mind
from testbed.student.parameters import ImaginationParameters, SelfDiscoveryParameters
from testbed.world.bullet import SimulatedBackend
from testbed.world.env import World

CORES = 2
PAPER_TRIALS, PAPER_MINUTES = 30, 30


def rows() -> list[Row]:
    """Every measurement of this file, as rows of benchmarks/results.json."""
    return [stereo_pair(), self_discovery(), one_candidate(), one_trial()]


def self_discovery() -> Row:
    """Fifty iterations, each ten commands of a simulated body, in seconds, against 5."""
    body, parameters = load_robot("crawler"), SelfDiscoveryParameters()
    prior, seconds = BodyPrior.of(body), []
    with Imagination(ImaginationParameters(), 1 / 60) as imagination:
        for seed in range(5):
            rng = np.random.default_rng(seed)
            commands = random_commands(prior, parameters, rng)
            tilt = imagination.settle(body, commands, limit=parameters.settle_time, rest_speed=0.02)
            begin = time.perf_counter()
            evolve_self_model(prior, commands, tilt, imagination, parameters, rng, lambda done, total: None)
            seconds.append(time.perf_counter() - begin)
    ours = np.array(seconds)
    return row("self-discovery, 50 iterations", "target seconds", 1.0, np.full_like(ours, 5.0), ours)


def one_candidate() -> Row:
    """What `like_me` makes of one candidate, from the first frame to the verdict, in seconds, against 5."""
    scenario = with_overrides(load_scenario("whom_to_imitate"), seed=10_000)
    scenario = scenario.model_copy(update={"beside": ()})
    backend = SimulatedBackend(scenario)
    world = World(scenario, backend=backend)
    student = student_of(scenario, np.random.SeedSequence(1))
    try:
        live(world, backend, student, 1, Witness(scenario, backend))
    finally:
        world.close()
    life, seconds = student.life, []
    assert life is not None
    prior, senses = BodyPrior.of(scenario.student.body()), senses_of(scenario)
    for seed in range(3):
        for number, candidate in enumerate(life.candidates):
            mind = Mind(scenario.student, prior, senses, np.random.SeedSequence(seed), silent, {})
            mind.itself = life.selves[life.leader]
            begin = time.perf_counter()
            mind.consider(number, candidate.watched, candidate.judgements[life.leader].looks)
            seconds.append(time.perf_counter() - begin)
    ours = np.array(seconds)
    return row("like_me: one candidate to its verdict", "target seconds", 1.0, np.full_like(ours, 5.0), ours)


def one_trial() -> Row:
    """A whole trial of the scenario `paper` on one core, against its share of 30 minutes on two."""
    scenario, seconds = load_scenario("paper"), []
    for trial in range(3):
        begin = time.perf_counter()
        run_trial(scenario, 10_000 + trial)
        seconds.append(time.perf_counter() - begin)
    ours = np.array(seconds)
    share = PAPER_MINUTES * 60 * CORES / PAPER_TRIALS
    return row("one trial of scenarios/paper.yaml", "target seconds", 1.0, np.full_like(ours, share), ours)


def stereo_pair() -> Row:
    """A stereo pair of the world, against the same renderer with Bullet's own ground drawn."""
    backend = SimulatedBackend(load_scenario("paper"))
    chequered = SimulatedBackend(load_scenario("paper"))
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=chequered._simulation.client)
    pybullet.createMultiBody(0, plane, physicsClientId=chequered._simulation.client)

    def look(eyes: SimulatedBackend) -> Callable[[], object]:
        return eyes._expose_pair

    try:
        return against(
            "a stereo pair of the world",
            "PyBullet, ground drawn",
            2.0,
            look(backend),
            look(chequered),
            turns=1,
        )
    finally:
        backend.close()
        chequered.close()
