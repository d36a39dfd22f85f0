"""A trial's journal fed to a student once more: its thoughts without its robot."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from testbed.errors import UserError, shown_path
from testbed.experiment.diary import Told
from testbed.experiment.jobs import Job
from testbed.experiment.lived import EndOfRecordError, Lived
from testbed.experiment.record import Row, TrialResult
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.trial import live, seeds_of, student_of
from testbed.experiment.trial_report import report_trial
from testbed.experiment.witness import Witness
from testbed.hardware.journal import Note
from testbed.scenario import drawn, in_cell
from testbed.student.agent import Life
from testbed.student.senses import Progress, silent
from testbed.world.bullet import bodies_of
from testbed.world.env import World


@dataclass(frozen=True)
class Replayed:
    """What came of it.

    Attributes:
        steps: How many steps the journal holds.
        life: What the student came to believe; None if the journal ends before its life does.
        rows: The trial's rows, without what only the truth could tell; empty without a life.
        notes: How often the trial broke off and why, and where it went on.
        arrays: The trial's arrays, likewise; see :mod:`testbed.experiment.trial_report`.
    """

    steps: int
    life: Life | None
    rows: tuple[Row, ...]
    notes: tuple[Note, ...]
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)


def journal_of(run: RunDirectory, job: Job) -> Path:
    """Where a trial's journal is kept."""
    return journal_below(run.path, job)


def journal_below(folder: Path, job: Job) -> Path:
    """Where a trial's journal is kept in the run directory ``folder``."""
    return folder / "trials" / job.cell / f"{job.trial}.journal"


def replay(run: RunDirectory, job: Job, progress: Progress = silent) -> Replayed:
    """Let a new student meet again what a trial's student met.

    Args:
        run: The run.
        job: Which trial.
        progress: Told how far each phase is.

    Raises:
        UserError: If there is no journal, or this student does not do what that one did.
    """
    path = journal_of(run, job)
    if not path.exists():
        what = f"{job} of {shown_path(run.path)} has no journal"
        raise UserError(what, "trials on a bench have one: run with --backend hardware")
    told = Told(path)
    if not told.steps:
        return Replayed(0, None, (), tuple(told.notes))
    here = drawn(in_cell(run.scenario, job.cell), job.trial)
    seed, chances = seeds_of(run.scenario, job.trial)
    lived = Lived(
        bodies_of(here),
        told.steps,
        live=None,
        control_step=here.world.control_step,
        name=shown_path(path),
    )
    world, witness = World(here, backend=lived), Witness(here, lived)
    student = student_of(here, chances, progress, witness.insider())
    result = TrialResult((), {})
    try:
        log = live(world, lived, student, seed, witness)
    except EndOfRecordError:
        pass
    else:
        assert student.life is not None
        result = report_trial(here, job.trial, job.cell, bodies_of(here), student.life, log)
    return Replayed(len(told.steps), student.life, result.rows, tuple(told.notes), result.arrays)
