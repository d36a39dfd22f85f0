"""Run a scenario: what a run is, from top to bottom."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from testbed.errors import UserError, did_you_mean, shown_path
from testbed.experiment import provenance, tables, verdicts
from testbed.experiment.backends import HARDWARE, backend_of
from testbed.experiment.executor import Compute, Executor, InProcessExecutor
from testbed.experiment.jobs import Job, jobs_of
from testbed.experiment.life import live, live_on
from testbed.experiment.process_executor import ProcessExecutor
from testbed.experiment.record import TrialResult
from testbed.experiment.run_directory import RunDirectory, default_path
from testbed.experiment.warming import warming
from testbed.scenario import Scenario, cell_names, may_be_left_out, sweep_of

if TYPE_CHECKING:
    from testbed.experiment.stage import Opener

EXECUTORS = ("processes", "ray")


class Display(Protocol):
    """Shows a run as it goes."""

    def started(self, path: Path, total: int, finished: int) -> None:
        """A run of ``total`` trials begins, of which so many were ``finished`` before."""

    def progressed(self, job: Job, phase: str, done: int, total: int) -> None:
        """A trial has gone some way through a phase."""

    def finished(self, job: Job) -> None:
        """A trial is done and safely on the disk."""

    def failed(self, job: Job, why: str, file: Path) -> None:
        """A trial failed; the traceback is in ``file``."""

    def left_out(self, job: Job, why: str) -> None:
        """A trial cannot be, and the scenario says that this is no failure."""

    def notice(self, text: str) -> None:
        """Something that the user should know, in one line."""


class Quiet:
    """A display that shows nothing."""

    def started(self, path: Path, total: int, finished: int) -> None:
        """Nothing."""

    def progressed(self, job: Job, phase: str, done: int, total: int) -> None:
        """Nothing."""

    def finished(self, job: Job) -> None:
        """Nothing."""

    def failed(self, job: Job, why: str, file: Path) -> None:
        """Nothing."""

    def left_out(self, job: Job, why: str) -> None:
        """Nothing."""

    def notice(self, text: str) -> None:
        """Nothing."""


@dataclass(frozen=True)
class Outcome:
    """What a run came to.

    Attributes:
        path: The run directory.
        verdicts: The contents of ``verdicts.json``, of every trial that finished.
        failed: The trials that did not finish; running again tries them again.
        left_out: The trials of a sweep that cannot be, and may: see ``impossible`` of
            :class:`testbed.scenario.sweep.SweepSpec`.
    """

    path: Path
    verdicts: dict[str, Any]
    failed: tuple[Job, ...]
    left_out: tuple[Job, ...] = ()


@dataclass(frozen=True)
class OnBench:
    """A bench in the simulation's place.

    Attributes:
        stage: Opens it for a trial.
        about: What ``provenance.json`` is to say of it.
    """

    stage: Opener
    about: Mapping[str, Any] = field(default_factory=dict)


def run(
    scenario: Scenario,
    *,
    out: Path | None = None,
    workers: int = 1,
    executor: Executor | None = None,
    display: Display | None = None,
    compute: Compute | None = None,
    bench: OnBench | None = None,
) -> Outcome:
    """Compute every trial of a scenario that is not yet finished, and sum up.

    Args:
        scenario: What to run; ``scenario.trials`` is the total, trials of earlier runs included.
        out: The run directory; ``runs/<scenario>-<hash8>`` by default.
        workers: How many processes; 1 computes in this one.
        executor: Who computes; by default so many processes.
        display: Shows progress.
        compute: Computes one trial; the student's whole life by default.
        bench: Where trials take place, one at a time; in simulation if not given. What a trial lives through is
            kept in a journal, from which it goes on where the bench failed it.

    Raises:
        UserError: If the run directory cannot be used, the disk fills up, or a trial of a scenario without cells
            meets a mistake of the user's, which every other trial would meet as well. A mistake in one of several
            cells is a failure of its trials. Finished trials are kept.
    """
    display = display or Quiet()
    path, lives = out or default_path(scenario), compute is None and bench is None
    if bench is not None:
        compute, executor = functools.partial(live_on, bench.stage, path, scenario), InProcessExecutor()
    _refuse_another_backend(path, bench)
    with RunDirectory.prepare(path, scenario, lambda: _described(scenario, bench)) as directory:
        _tell_changed_source(directory, display)
        jobs = jobs_of(scenario)
        finished = directory.finished(jobs, display.notice)
        remaining = [job for job in jobs if job not in finished]
        display.started(path, len(jobs), len(finished))
        recorder = _Recorder(directory, display, stops=bench is not None)
        idle = _idle(workers, len(remaining)) if executor is None else 0
        compute = compute or functools.partial(live, scenario, idle=idle)
        executor = executor or executor_for(min(workers, len(remaining)))
        here = lives and remaining and isinstance(executor, InProcessExecutor)  # workers keep the cores busy
        with warming() if here else nullcontext():
            executor.run(remaining, compute, recorder)
        contents = summed_up(directory)
        verdicts.write(path, contents)
        return Outcome(path, contents, tuple(recorder.lost), tuple(recorder.left_out))


def executor_for(workers: int | None, kind: str = "processes", address: str | None = None) -> Executor:
    """The executor for this many workers.

    Args:
        workers: How many at a time; None: as many as there are cores.
        kind: One of ``EXECUTORS``.
        address: Of a running Ray cluster.

    Raises:
        UserError: If there is no such executor, or the address is not for it.
    """
    if kind not in EXECUTORS:
        what = f"there is no executor '{kind}'"
        raise UserError(what, did_you_mean(kind, EXECUTORS, kind="executors"))
    if kind == "ray":
        from testbed.experiment.ray_executor import RayExecutor

        return RayExecutor(workers, address)
    if address is not None:
        raise UserError("processes are on this machine and have no address", "add '--executor ray'")
    workers = workers or len(os.sched_getaffinity(0))
    return ProcessExecutor(workers) if workers > 1 else InProcessExecutor()


def _idle(workers: int, trials: int) -> int:
    """How many cores are left for each trial where there are fewer trials than workers."""
    return min(workers, len(os.sched_getaffinity(0))) // max(trials, 1) - 1


def summed_up(directory: RunDirectory) -> dict[str, Any]:
    """The contents of ``verdicts.json`` from the trials of the scenario that are finished.

    Raises:
        UserError: If a finished trial is damaged.
    """
    jobs = [job for job in jobs_of(directory.scenario) if directory.is_finished(job)]
    rows = [row for job in jobs for row in directory.read_rows(job)]
    tables.keep(directory, jobs, rows)
    scenario = directory.scenario
    return verdicts.document(
        scenario.name,
        directory.hash8,
        rows,
        scenario.seed,
        split=scenario.split,
        sweep=verdicts.sweep_rows(sweep_of(scenario)),
    )


class _Recorder:
    """Puts what the executor tells on the disk first and on the display second."""

    def __init__(self, directory: RunDirectory, display: Display, *, stops: bool = False) -> None:
        self._directory = directory
        self._display = display
        self.progressed: Callable[[Job, str, int, int], None] = display.progressed
        self.lost: list[Job] = []
        self.left_out: list[Job] = []
        # On a bench that has failed one trial the next would fail as well.
        self._alone = stops or len(cell_names(directory.scenario)) == 1

    def finished(self, job: Job, result: TrialResult) -> None:
        self._directory.write_trial(job, result)
        self._display.finished(job)

    def mistaken(self, job: Job, error: UserError) -> None:
        if self._alone:
            raise error
        if not may_be_left_out(self._directory.scenario, job.cell):
            self.failed(job, str(error), f"{error}\n")
            return
        self.left_out.append(job)
        self._directory.write_error(job, f"{error}\n")
        self._display.left_out(job, str(error))

    def failed(self, job: Job, why: str, details: str) -> None:
        self.lost.append(job)
        self._display.failed(job, why, self._directory.write_error(job, details))


def _described(scenario: Scenario, bench: OnBench | None) -> dict[str, Any]:
    described = provenance.describe(scenario)
    return described if bench is None else {**described, "backend": HARDWARE, **bench.about}


def _refuse_another_backend(path: Path, bench: OnBench | None) -> None:
    """Trials of the simulation and of a bench never mix in one run."""
    if not (path / "provenance.json").is_file():
        return
    there = backend_of(RunDirectory.open(path))
    if (there == HARDWARE) != (bench is not None):
        what = f"{shown_path(path)} holds a run {'on a bench' if there == HARDWARE else 'in simulation'}"
        raise UserError(what, "give another folder with --out DIR")


def _tell_changed_source(directory: RunDirectory, display: Display) -> None:
    before, now = directory.provenance.get("source"), provenance.source_revision()
    if before != now:
        display.notice(
            "this run was begun with another version of the source; delete it to compute it all anew"
        )
