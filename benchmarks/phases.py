"""Single phases of a student's life against the time that they may take."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import numpy as np

from benchmarks.measure import Settings, interleaved
from benchmarks.row import Row, within
from benchmarks.trials import SEED
from testbed.bodies.morphology import load_robot
from testbed.experiment.trial import live, senses_of, student_of
from testbed.experiment.witness import Witness
from testbed.scenario import load_scenario, with_overrides
from testbed.student.body.imagination import Imagination
from testbed.student.body.self_discovery import evolve_self_model, random_commands
from testbed.student.body.self_model import BodyPrior
from testbed.student.mind import Mind
from testbed.student.parameters import ImaginationParameters, SelfDiscoveryParameters
from testbed.student.senses import silent
from testbed.world.bullet import SimulatedBackend
from testbed.world.env import World

SECONDS = 5.0


def rows(settings: Settings) -> Iterator[Row]:
    """The paper's self-discovery, and what `like_me` makes of a candidate; another seed in each round."""
    with Imagination(ImaginationParameters(), 1 / 60) as imagination:
        calls = {"discovery": discovering(imagination), "candidate": considering()}
        times = interleaved(calls, settings.rounds, once=True)
    yield within("self-discovery of paper, 50 iterations of ten commands", SECONDS, times["discovery"])
    yield within("like_me: one candidate, from the first frame to its verdict", SECONDS, times["candidate"])


def discovering(imagination: Imagination) -> Callable[[], object]:
    """Section 3.2 with the shipped parameters."""
    body, parameters, seeds = load_robot("crawler"), SelfDiscoveryParameters(), itertools.count()
    prior = BodyPrior.of(body)

    def discover() -> object:
        rng = np.random.default_rng(next(seeds))
        commands = random_commands(prior, parameters, rng)
        tilt = imagination.settle(body, commands, limit=parameters.settle_time, rest_speed=0.02)
        return evolve_self_model(
            prior, commands, tilt, imagination, parameters, rng, lambda done, total: None
        )

    return discover


def considering() -> Callable[[], object]:
    """The candidates of one life, taken up again by a fresh mind that knows its body."""
    scenario = with_overrides(load_scenario("whom_to_imitate"), seed=SEED).model_copy(update={"beside": ()})
    backend = SimulatedBackend(scenario)
    world = World(scenario, backend=backend)
    student = student_of(scenario, np.random.SeedSequence(1))
    try:
        live(world, backend, student, 1, Witness(scenario, backend))
    finally:
        world.close()
    life, seeds = student.life, itertools.count()
    assert life is not None
    prior, senses = BodyPrior.of(scenario.student.body()), senses_of(scenario)

    def consider() -> object:
        seed = next(seeds)
        number = seed % len(life.candidates)
        candidate = life.candidates[number]
        mind = Mind(scenario.student, prior, senses, np.random.SeedSequence(seed), silent, {})
        mind.itself = life.selves[life.leader]
        thought = mind.consider(number, candidate.watched, candidate.judgements[life.leader].looks)
        return thought(silent)

    return consider
