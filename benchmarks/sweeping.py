"""What does a sweep cost beyond its work, and what does a second core bring? 200 cells, two verdicts each."""

from __future__ import annotations

import functools
import hashlib
import multiprocessing
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measure import Settings, pinned, ratio
from benchmarks.row import Row, faster, within
from testbed.experiment.executor import Compute, Executor, InProcessExecutor, Progress
from testbed.experiment.jobs import Job
from testbed.experiment.process_executor import ProcessExecutor
from testbed.experiment.record import TrialResult
from testbed.experiment.runner import run
from testbed.scenario import Scenario, parse_scenario

CELLS = 200
MOST_OVERHEAD = 0.05  # s a cell
SPEED_UP = 1.7
HASHES = 350_000  # about a seventh of a second; real cells take some seconds
ROUNDS = 4
SHARE = 0.2  # of a sweep's work, to see what the machine gives to two processes
SWEEP = """\
name: light
student: like_me
teachers: [{robot: crawler, gait: {kind: still}}]
sweep:
  over:
    teachers.all.scale: {uniform: [0.5, 1], steps: 20}
    rig.camera_noise: {uniform: [1, 10], steps: 10}
"""


def rows(settings: Settings) -> Iterator[Row]:
    """Overhead on one core; then both."""
    cells = np.array([seconds_of(_sweep(), trivial, InProcessExecutor()) / CELLS for _ in range(5)])
    yield within(
        "overhead a cell of a sweep", MOST_OVERHEAD, cells, note="by the clock, to the written verdicts.json"
    )
    with pinned(pin=False):
        yield two_cores()


def two_cores() -> Row:
    """The same sweep in two processes against one, start-up and writing included.

    Two cores of a rented or shared machine are rarely twice one. In the same turns plain processes do some of the same
    work without a sweep, one alone and two at a time; what that gives is noted beside the row.
    """
    compute = functools.partial(burning, HASHES)
    seconds = np.array([[*_sweeps(compute), *_bare(HASHES)] for _ in range(ROUNDS)]).T
    middle, low, high = ratio(seconds[2], seconds[3])
    note = f"by the clock; two plain processes here: {middle:.2f} ({low:.2f} to {high:.2f})"
    return faster(
        "a sweep of 200 cells on two cores", "one core", seconds[0], seconds[1], SPEED_UP, note=note
    )


def _sweeps(compute: Compute) -> tuple[float, float]:
    """Seconds of the sweep in one process and in two."""
    one, two = InProcessExecutor(), ProcessExecutor(2)
    return seconds_of(_sweep(), compute, one), seconds_of(_sweep(), compute, two)


def _bare(hashes: int) -> tuple[float, float]:
    """Seconds of a share of its work in one plain process, and in two that do half each; without their start-up."""
    portions = round(SHARE * CELLS)
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        list(pool.map(time.sleep, [0.5, 0.5]))  # both are there
        begin = time.perf_counter()
        pool.submit(_hash, hashes, portions).result()
        one = time.perf_counter() - begin
        begin = time.perf_counter()
        halves = [pool.submit(_hash, hashes, portions // 2) for _ in range(2)]
        for half in halves:
            half.result()
        return one, time.perf_counter() - begin


def _hash(hashes: int, times: int = 1) -> None:
    for _ in range(times):
        hashlib.pbkdf2_hmac("sha256", b"work", b"", hashes)


def trivial(job: Job, progress: Progress) -> TrialResult:
    """Verdicts that follow from the job alone."""
    rng = np.random.default_rng([job.trial, *hashlib.sha256(job.cell.encode()).digest()[:4]])
    found: list[dict[str, Any]] = []
    for index, truth in enumerate(("appropriate", "inappropriate")):
        score = float(rng.normal(1 - index))
        verdict = "appropriate" if score > 0.5 else "inappropriate"
        names = {"cell": job.cell, "trial": job.trial, "student": "like_me", "teacher": f"teacher_{index}"}
        found.append(
            {**names, "robot": "crawler", "truth": truth, "verdict": verdict, "score": score, "found": True}
        )
    return TrialResult(rows=tuple(found), arrays={"noise": rng.normal(size=1000)})


def burning(hashes: int, job: Job, progress: Progress) -> TrialResult:
    """The same after some arithmetic."""
    _hash(hashes)
    return trivial(job, progress)


def _sweep() -> Scenario:
    return parse_scenario(SWEEP)


def seconds_of(scenario: Scenario, compute: Compute, executor: Executor) -> float:
    """A run of the scenario, from the first trial to the written verdicts.json, by the clock."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        outcome = run(scenario, out=Path(folder) / "run", executor=executor, compute=compute)
        seconds = time.perf_counter() - begin
    assert not outcome.failed
    return seconds
