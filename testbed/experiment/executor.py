"""Who computes the trials: this process, or worker processes that may be killed without harm.

An executor computes jobs in any order and tells a listener, always in the process that called it, what
happens. Writing results down is the listener's work, so an executor on other machines needs no shared disk.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from testbed.errors import UserError, is_interrupt
from testbed.experiment.jobs import Job
from testbed.experiment.record import TrialResult

Progress = Callable[[str, int, int], None]
"""(phase, done, total), called by a trial as it goes."""

Compute = Callable[[Job, Progress], TrialResult]
"""Computes a trial; must be picklable, as it travels to workers."""


class Listener(Protocol):
    """Hears what becomes of jobs."""

    def progressed(self, job: Job, phase: str, done: int, total: int) -> None:
        """A trial has gone some way through a phase."""

    def finished(self, job: Job, result: TrialResult) -> None:
        """A trial is done; if this raises, the executor stops everything and passes it on."""

    def mistaken(self, job: Job, error: UserError) -> None:
        """A trial cannot be, for a mistake of the user's; if this raises, everything stops."""

    def failed(self, job: Job, why: str, details: str) -> None:
        """A trial ended without a result: ``why`` in one line, ``details`` with the traceback."""


class Executor(Protocol):
    """Computes jobs."""

    def run(self, jobs: Sequence[Job], compute: Compute, listener: Listener) -> None:
        """Compute every job and return when each has finished or failed; leaves no process behind.

        Raises:
            Exception: Whatever the listener raises; all computing then stops.
        """


class InProcessExecutor:
    """One trial after the other, here: the easiest to debug."""

    def run(self, jobs: Sequence[Job], compute: Compute, listener: Listener) -> None:
        """Compute every job; a trial that raises has failed, and the next goes on."""
        for job in jobs:

            def progress(phase: str, done: int, total: int, job: Job = job) -> None:
                listener.progressed(job, phase, done, total)

            try:
                result = compute(job, progress)
            except UserError as error:
                listener.mistaken(job, error)
            except Exception as error:
                if is_interrupt(error):
                    raise KeyboardInterrupt from error
                listener.failed(job, summary(error), traceback.format_exc())
            else:
                listener.finished(job, result)


def outcome_of(job: Job, compute: Compute, progress: Progress) -> tuple[Any, ...]:
    """What became of a job, for a worker to send home: the name of a listener's method and its arguments."""
    try:
        return "finished", compute(job, progress)
    except UserError as error:
        return "mistaken", error
    except Exception as error:
        return "failed", summary(error), traceback.format_exc()


def summary(error: BaseException) -> str:
    """An exception in one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
