"""How cost grows: with parts, pixels, teachers, trials and workers. The exponent of a power law, 1 for linear."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from benchmarks import sweeping
from benchmarks.living import CONTROL_STEP, PAPER, gaits
from benchmarks.measure import Settings, exponent, interleaved, pinned
from benchmarks.row import Row, in_words, measured
from benchmarks.scenes import MODELS, RIG, models, pixels, rays
from benchmarks.seeing import kernel
from benchmarks.trials import SEED
from testbed.bodies.morphology import CappedCylinder, Cuboid, Joint, Morphology
from testbed.experiment.executor import InProcessExecutor
from testbed.experiment.process_executor import ProcessExecutor
from testbed.experiment.trial import run_trial
from testbed.scenario import Scenario, load_scenario, parse_scenario, with_overrides
from testbed.student.body.imagination import Imagination
from testbed.student.body.settling import Settler
from testbed.student.parameters import ImaginationParameters, TeacherModellingParameters
from testbed.student.seeing.teacher_modelling import Modelling
from testbed.vision import render
from testbed.world.env import World
from testbed.world.placement import STUDENT

LINEAR = 1.1
"""A tenth above one is for noise: the whole interval is to be below."""
PARTS = (1, 2, 3, 4, 5, 6, 7, 8)
PIXELS = (500, 1000, 2000, 4000, 7500)
TEACHERS = (1, 2, 4, 8)
LIVED_WITH = (1, 2, 4)
TRIALS = (50, 100, 200, 400)
WORKERS = (1, 2, 4, 8)
FEW = 3
NOTHING = "name: nothing\nstudent: like_me\nteachers: [{robot: crawler, gait: still}]\n"

Sized = Callable[[int], Callable[[], object]]


def rows(settings: Settings) -> Iterator[Row]:
    """Everything that may grow, on one core but for the workers."""
    rounds = settings.rounds
    yield grown("luminosity of K pixels", PIXELS, looking_at_pixels, rounds, each=MODELS)
    yield grown("luminosity of 1000 pixels, k parts", PARTS, looking_at_parts, rounds, each=MODELS)
    yield grown("teacher modelling, 1000 passes, k parts", PARTS, modelling, rounds)
    with Imagination(ImaginationParameters(), CONTROL_STEP) as imagination:
        yield grown("fifteen seconds of settling in PyBullet, k parts", PARTS, settling(imagination), FEW)
        yield grown("240 steps of a controller in PyBullet, k parts", PARTS, moving(imagination), rounds)
    yield grown("ten commands settled quasi-statically, k parts", PARTS, solving, rounds)
    yield grown("a world step without images, n teachers", TEACHERS, world_with, rounds)
    yield grown("a short trial of `paper`, n teachers", LIVED_WITH, living_with, FEW, once=True)
    yield grown("n trials that cost nothing, to verdicts.json", TRIALS, recording, FEW, once=True)
    with pinned(pin=False):
        yield grown(
            "starting w workers, by the clock", WORKERS, hiring, FEW, once=True, clock=time.perf_counter
        )


def grown(
    name: str,
    sizes: Sequence[int],
    sized: Sized,
    rounds: int,
    *,
    each: int = 1,
    once: bool = False,
    clock: Callable[[], float] = time.process_time,
) -> Row:
    """The exponent; all sizes have their turns in each round. A call does its work ``each`` times."""
    calls = {str(size): sized(size) for size in sizes}
    times = interleaved(calls, rounds, once=once, clock=clock)
    seconds = np.column_stack(list(times.values())) / each
    note = f"{in_words(seconds[:, 0])} at {sizes[0]}, {in_words(seconds[:, -1])} at {sizes[-1]}"
    return measured(
        f"growth: {name}",
        "exponent",
        exponent(sizes, seconds),
        LINEAR,
        "at most",
        rounds=rounds,
        note=note,
        peer="linear",
    )


def looking_at_pixels(count: int) -> Callable[[], object]:
    return kernel(models(3), rays(pixels(count)), RIG.eyes[0])


def looking_at_parts(parts: int) -> Callable[[], object]:
    return kernel(models(parts), rays(pixels(1000)), RIG.eyes[0])


def modelling(parts: int) -> Callable[[], object]:
    images = render(models(parts, 1)[0], RIG)
    return lambda: Modelling(RIG, parts, TeacherModellingParameters(), np.random.default_rng(SEED)).observe(
        *images
    )


def settling(imagination: Imagination) -> Sized:
    def sized(parts: int) -> Callable[[], object]:
        # Never slow enough to be at rest: how soon it is depends on the body more than on its parts.
        body, commands = chain(parts), random_commands(parts)
        return lambda: imagination.settle(body, commands, limit=PAPER.settle_time, rest_speed=0.0)

    return sized


def moving(imagination: Imagination) -> Sized:
    def sized(parts: int) -> Callable[[], object]:
        body = chain(parts)
        motion = gaits(body, 1)[0]

        def call() -> None:
            with imagination.imagine(body) as rehearsal:
                rehearsal.move(motion)

        return call

    return sized


def solving(parts: int) -> Callable[[], object]:
    body, commands = chain(parts), random_commands(parts)
    return lambda: Settler(body).tilt(commands)


def chain(parts: int) -> Morphology:
    """The paper's main body with limbs one behind the other, .4 m in all."""
    limb = CappedCylinder(radius=0.01, length=0.4 / max(parts - 1, 1), friction=0.9)
    names = ["body", *(f"limb_{i}" for i in range(1, parts))]
    shapes = dict.fromkeys(names[1:], limb)
    joints = {f"joint_{i}": Joint(parent=names[i - 1], child=names[i]) for i in range(1, parts)}
    return Morphology(
        name="chain", parts={"body": Cuboid(size=(0.14, 0.11, 0.05), friction=0.25), **shapes}, joints=joints
    )


def random_commands(parts: int) -> np.ndarray:
    return np.random.default_rng(SEED).uniform(-math.pi / 3, math.pi / 3, (10, parts - 1))


def crowd(teachers: int) -> Scenario:
    """The scenario `paper` with so many crawlers around the student."""
    scenario = with_overrides(load_scenario("paper"), seed=SEED)
    bearings = np.linspace(-60, 60, teachers) if teachers > 1 else [-30.0]
    some = [
        scenario.teachers[0].model_copy(
            update={"bearing_deg": float(bearing), "distance": 1.0 + 0.3 * (i % 2)}
        )
        for i, bearing in enumerate(bearings)
    ]
    return scenario.model_copy(update={"teachers": tuple(some)})


def world_with(teachers: int) -> Callable[[], object]:
    scenario = crowd(teachers)
    world = World(scenario, images=False, max_cycles=10**9)
    world.reset(seed=SEED)
    still = {name: body.rest for name, body in world.backend.robots.items()}
    still[STUDENT] = np.append(still[STUDENT], 0.0)
    return lambda: world.step(still)


def living_with(teachers: int) -> Callable[[], object]:
    scenario = with_overrides(crowd(teachers), smoke=True)
    return lambda: run_trial(scenario, 0)


def recording(trials: int) -> Callable[[], object]:
    scenario = with_overrides(parse_scenario(NOTHING), trials=trials)
    return lambda: sweeping.seconds_of(scenario, sweeping.trivial, InProcessExecutor())


def hiring(workers: int) -> Callable[[], object]:
    """One short job for each worker of a crew that is hired for it."""
    scenario = with_overrides(parse_scenario(NOTHING), trials=workers)
    return lambda: sweeping.seconds_of(scenario, sweeping.trivial, ProcessExecutor(workers))
