"""Trials on a Ray cluster: one task each, on whatever nodes there are, while nodes come and go.

Results travel to the process that asked, which alone writes, so that the nodes share no disk. A task whose worker or
node dies is computed again elsewhere; so is a result that died with the node that held it.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from testbed.errors import UserError, one_line
from testbed.experiment.executor import Compute, Listener, outcome_of, summary
from testbed.experiment.jobs import Job

_MISSING = re.compile(r"No module named '[^']+'")
_RETRIES = 3  # how often Ray computes a task again after its worker or node died
_AHEAD = 2  # tasks asked for at a time, per core: nobody waits, and results do not pile up


class RayExecutor:
    """Computes jobs on a Ray cluster.

    Args:
        workers: How many at a time; as many as the cluster has cores if None.
        address: Of a running cluster, such as ``10.0.0.1:6379`` or ``auto``; by default that in ``RAY_ADDRESS``, or
            else a cluster that is started on this machine for the length of the run.
    """

    def __init__(self, workers: int | None = None, address: str | None = None) -> None:
        self.workers = workers
        self.address = address or os.environ.get("RAY_ADDRESS") or None

    def run(self, jobs: Sequence[Job], compute: Compute, listener: Listener) -> None:
        """Compute every job; see :class:`testbed.experiment.executor.Executor`. There is no progress within a trial.

        Raises:
            UserError: If Ray is not installed, the cluster does not answer, or its nodes do not have this package.
        """
        if not jobs:
            return
        with _connected(self.address, self.workers) as ray:
            self._run(ray, jobs, compute, listener)

    def _run(self, ray: Any, jobs: Sequence[Job], compute: Compute, listener: Listener) -> None:
        task = ray.remote(num_cpus=1, max_retries=_RETRIES)(_outcome)
        shared, waiting = ray.put(compute), list(reversed(jobs))
        asked: dict[Any, Job] = {}
        try:
            while waiting or asked:
                while waiting and len(asked) < self._room(ray):
                    job = waiting.pop()
                    asked[task.remote(job, shared)] = job
                ready, _ = ray.wait(list(asked), num_returns=1)
                for done in ready:
                    _hear(ray, done, asked.pop(done), listener)
        finally:
            for left in asked:
                ray.cancel(left, force=True)

    def _room(self, ray: Any) -> int:
        return self.workers or max(1, _AHEAD * int(ray.cluster_resources().get("CPU", 1)))


def _outcome(job: Job, compute: Compute) -> tuple[Any, ...]:
    return outcome_of(job, compute, lambda phase, done, total: None)


def _hear(ray: Any, done: Any, job: Job, listener: Listener) -> None:
    try:
        kind, *message = ray.get(done)
    except (
        ray.exceptions.RayTaskError
    ) as error:  # our own code catches what a trial raises: it did not come so far
        missing = _MISSING.search(str(error))
        if missing:
            what = f"a node of the Ray cluster cannot load what computes ({missing.group()})"
            raise UserError(what, "install the same version of the testbed on every node") from None
        raise
    except ray.exceptions.RayError as error:
        why = f"its worker was lost ({summary(error)[:200]})"
        listener.failed(job, why, f"{why}, {_RETRIES + 1} times\n")
    else:
        getattr(listener, kind)(job, *message)


@contextmanager
def _connected(address: str | None, workers: int | None) -> Iterator[Any]:
    # Read when Ray is loaded and started.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is told to anybody
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # it warns of a default that will change
    if address is None:
        os.environ.setdefault(
            "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0"
        )  # listen to this machine only, whichever it is
        os.environ.setdefault(
            "RAY_worker_niceness", "0"
        )  # beside others' work as quick as processes, not starved
    try:
        import ray
    except ImportError:
        raise UserError(
            "the executor 'ray' needs Ray, which is not installed", "pip install 'whom-to-imitate[ray]'"
        ) from None
    if ray.is_initialized():
        yield ray  # by whoever calls us; left as it is
        return
    quiet: dict[str, Any] = {"log_to_driver": False, "logging_level": logging.ERROR}
    try:
        if address is None:
            cores = workers or len(os.sched_getaffinity(0))
            ray.init(address="local", include_dashboard=False, num_cpus=cores, **quiet)
        else:
            ray.init(address=address, **quiet)
    except (ConnectionError, RuntimeError, TimeoutError, ValueError) as error:
        what = f"no Ray cluster answers at {address}" if address else "Ray cannot be started here"
        mend = "start one with `ray start --head` and give its address" if address else "see its message"
        raise UserError(f"{what} ({one_line(str(error))[:200]})", mend) from None
    try:
        yield ray
    finally:
        ray.shutdown()
