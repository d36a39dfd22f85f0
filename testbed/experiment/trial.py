"""One trial: a student lives among its teachers, and afterwards its beliefs are held against the truth."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from testbed.experiment.diary import Diary
from testbed.experiment.elsewhere import Elsewhere
from testbed.experiment.jobs import DEFAULT_CELL
from testbed.experiment.record import TrialResult
from testbed.experiment.stage import Opener, simulated
from testbed.experiment.teacher_report import rig_of
from testbed.experiment.trial_report import report_trial
from testbed.experiment.witness import Witness
from testbed.scenario import Scenario, drawn, in_cell
from testbed.student.agent import Student
from testbed.student.body.self_model import BodyPrior
from testbed.student.insider import Insider
from testbed.student.senses import Progress, Senses, silent
from testbed.world.backend import Backend
from testbed.world.env import World
from testbed.world.gaits import scripted_policy
from testbed.world.placement import STUDENT, teacher_names

Arrays = dict[str, NDArray[Any]]


def run_trial(
    scenario: Scenario,
    trial: int,
    progress: Progress = silent,
    *,
    cell: str = DEFAULT_CELL,
    stage: Opener = simulated,
    journal: Path | None = None,
    idle: int = 0,
) -> TrialResult:
    """Let the scenario's student live among its teachers once.

    Args:
        scenario: Who is in the world.
        trial: Which trial; with the scenario's seed it decides all that is left to chance.
        progress: Told how far each phase is.
        cell: Which of the scenario's cells. The same trial of another cell has the same chances.
        stage: Opens the world that they live in.
        journal: The file that every step is written to. If it is there, the trial that it holds goes on where it
            broke off.
        idle: How many cores have nothing else to do; minds beside the leader think there.

    Raises:
        UserError: If the world fails, as a bench can; what was lived until then is in the journal.
    """
    here = drawn(in_cell(scenario, cell), trial)
    world_seed, student_seeds = seeds_of(scenario, trial)
    with contextlib.ExitStack() as stack:
        diary = stack.enter_context(Diary(journal)) if journal is not None else None
        opened = stack.enter_context(contextlib.closing(stage(here, diary.journal if diary else None)))
        backend, truth = opened.backend, opened.truth
        lived = diary.lived(here, opened) if diary is not None else None
        if lived is not None:
            truth = backend = lived
        world = World(here, backend=backend)
        witness = Witness(here, backend, truth)
        # One more than there are idle cores: where the leader is done and waits, there is one more.
        elsewhere = stack.enter_context(Elsewhere(idle + 1)) if idle > 0 else None
        if elsewhere is not None:
            progress = elsewhere.heeding(progress)
        student = student_of(here, student_seeds, progress, witness.insider(), elsewhere)
        log = live(world, backend, student, world_seed, witness, think=opened.think)
        if diary is not None and lived is not None:
            diary.finish()
            log |= {"time/put_back": np.array(lived.put_back)} if lived.put_back else {}
    assert student.life is not None
    bodies = {**backend.robots, STUDENT: here.student.true_body()}
    return report_trial(here, trial, cell, bodies, student.life, log)


def seeds_of(scenario: Scenario, trial: int) -> tuple[int, np.random.SeedSequence]:
    """What is left to chance in a trial: of the world, and of the student."""
    world, student = np.random.SeedSequence([scenario.seed, trial]).spawn(2)
    return int(world.generate_state(1)[0]), student


def student_of(
    scenario: Scenario,
    seeds: np.random.SeedSequence,
    progress: Progress = silent,
    insider: Insider | None = None,
    elsewhere: Elsewhere | None = None,
) -> Student:
    """The scenario's student, with all the minds that it has; an insider is for baselines among them."""
    prior = BodyPrior.of(scenario.student.body())
    return Student(prior, senses_of(scenario), scenario.minds, seeds, progress, insider, elsewhere)


def senses_of(scenario: Scenario) -> Senses:
    """What the scenario's student knows of its own equipment."""
    rig = scenario.rig
    return Senses(
        rig=rig_of(scenario),
        pan_limit=math.radians(rig.pan_limit_deg),
        pan_speed=math.radians(rig.pan_speed_deg),
        control_step=scenario.world.control_step,
        frame_time=1 / rig.camera_rate,
    )


def at_once(thought: Callable[[], NDArray[Any]]) -> NDArray[Any]:
    """Thinks while the world stands still."""
    return thought()


def live(
    world: World,
    backend: Backend,
    student: Student,
    seed: int,
    witness: Witness,
    *,
    think: Callable[[Callable[[], NDArray[Any]]], NDArray[Any]] = at_once,
) -> Arrays:
    """Everybody acts until the student is done; returns the truth about everybody at the start and after each step."""
    control_step = world.scenario.world.control_step
    policies = {
        name: scripted_policy(teacher.gait, backend.robots[name], control_step)
        for name, teacher in zip(teacher_names(world.scenario), world.scenario.teachers, strict=True)
    }
    observations, _ = world.reset(seed=seed)
    witness.note()
    while world.agents and not student.done:
        actions: Arrays = {name: policy.act(observations[name]) for name, policy in policies.items()}
        actions[STUDENT] = think(functools.partial(student.act, observations[STUDENT]))
        world.looking = student.looking
        observations, *_ = world.step(actions)
        witness.note(actions[STUDENT])
    if not student.done:
        raise world.scenario.source.error(
            ("world", "max_cycles"),
            f"the student was not done after world.max_cycles = {world.scenario.world.max_cycles} steps",
            "give it more; with the default parameters a life takes some 3000",
        )
    return witness.log()
