"""Trials in worker processes: one fresh, spawned process each, one pipe each.

Bullet holds Python's global lock, so parallel trials take processes. A worker owns no lock that others need
and writes no file, so it can be killed at any moment: its pipe closes, its trial goes to a new worker once
more, and only then counts as failed. Workers die with the process that started them, however that one dies.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any

from testbed.experiment.executor import Compute, Listener, outcome_of
from testbed.experiment.jobs import Job

_ATTEMPTS = 2
_QUIET_TIME = 0.1  # seconds between two progress messages of a phase
_GRACE = 2.0  # seconds that a worker gets to end before it is killed
_LOST = "lost"  # heard of a worker that says nothing more


@dataclass
class _Worker:
    process: SpawnProcess
    pipe: Connection
    job: Job | None = None


class ProcessExecutor:
    """Computes jobs in ``workers`` processes.

    Args:
        workers: How many, at least 1.
    """

    def __init__(self, workers: int) -> None:
        if workers < 1:
            raise ValueError("there must be at least one worker")
        self.workers = workers

    def run(self, jobs: Sequence[Job], compute: Compute, listener: Listener) -> None:
        """Compute every job; see :class:`testbed.experiment.executor.Executor`."""
        waiting = list(jobs)
        attempts = dict.fromkeys(jobs, 0)
        crew: list[_Worker] = []
        try:
            while waiting or any(worker.job for worker in crew):
                self._fill(crew, waiting, attempts, compute)
                for worker in _ready(crew):
                    job, what, *told = _hear(worker)
                    if what == _LOST:
                        crew.remove(worker)
                        if attempts[job] < _ATTEMPTS:
                            waiting.insert(0, job)
                            continue
                        what, told = "failed", [told[0], f"{told[0]}, {_ATTEMPTS} times\n"]
                    self._fill(crew, waiting, attempts, compute)  # nobody waits while the listener writes
                    getattr(listener, what)(job, *told)
        finally:
            _dismiss(crew)

    def _fill(
        self, crew: list[_Worker], waiting: list[Job], attempts: dict[Job, int], compute: Compute
    ) -> None:
        """Give every idle worker a job, and hire while there are jobs and room."""
        while waiting:
            idle = next((worker for worker in crew if worker.job is None), None)
            if idle is None:
                if len(crew) >= self.workers:
                    return
                idle = _hire(compute)
                crew.append(idle)
            idle.job = waiting.pop(0)
            attempts[idle.job] += 1
            try:
                idle.pipe.send(idle.job)
            except OSError:
                return  # it died while idle; its end is noticed, with its job, when listening


def _hire(compute: Compute) -> _Worker:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_work, args=(theirs, compute), daemon=True)
    with _interrupts_held():
        process.start()
    theirs.close()  # the worker holds the only other end, so that its death closes the pipe
    return _Worker(process, ours)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """A Ctrl-C goes to every process of the terminal; workers are born deaf to it and hear from us."""
    resource_tracker.ensure_running()  # it would unblock the signal again if it were started within
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _ready(crew: Sequence[_Worker]) -> list[_Worker]:
    ready = connection.wait([worker.pipe for worker in crew if worker.job])
    return [worker for worker in crew if worker.pipe in ready]


def _hear(worker: _Worker) -> tuple[Any, ...]:
    """A busy worker's message: its job, the listener's method, and the rest of what that is to be told."""
    job = worker.job
    try:
        what, *told = worker.pipe.recv()
    except (EOFError, OSError):
        worker.process.join(_GRACE)
        return job, _LOST, _fate(worker.process.exitcode)
    if what != "progressed":
        worker.job = None
    return job, what, *told


def _fate(exitcode: int | None) -> str:
    if exitcode is not None and exitcode < 0:
        name = signal.Signals(-exitcode).name
        memory = " (out of memory?)" if name == "SIGKILL" else ""
        return f"its worker process was killed by {name}{memory}"
    return f"its worker process ended by itself with status {exitcode}"


def _dismiss(crew: Sequence[_Worker]) -> None:
    for worker in crew:
        worker.process.terminate()
        worker.pipe.close()  # afterwards, or the worker would meet a closed pipe and complain
    for worker in crew:
        worker.process.join(_GRACE)
        if worker.process.is_alive():
            worker.process.kill()
            worker.process.join()
        worker.process.close()


def _work(pipe: Connection, compute: Compute) -> None:
    """The life of a worker: jobs in, messages out, until it is dismissed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_die_with_parent, daemon=True).start()
    while True:
        try:
            job: Job = pipe.recv()
            pipe.send(outcome_of(job, compute, Reporter(pipe)))
        except (EOFError, OSError):
            return  # nobody listens any more


class Reporter:
    """Sends progress, but not more often than anybody can read."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._phase = ""
        self._next = 0.0

    def __call__(self, phase: str, done: int, total: int) -> None:
        """Tell the other end of the pipe."""
        now = time.monotonic()
        if phase == self._phase and now < self._next and done < total:
            return
        self._phase, self._next = phase, now + _QUIET_TIME
        self._pipe.send(("progressed", phase, done, total))


def _die_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)
