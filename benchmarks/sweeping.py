"""What does a sweep cost beyond its work, and what does a second core bring? 200 cells, two verdicts each."""

from __future__ import annotations

import functools
import hashlib
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.measure import Row, row
from testbed.experiment.executor import Compute, Progress
from testbed.experiment.jobs import Job
from testbed.experiment.record import TrialResult
from testbed.experiment.runner import run
from testbed.scenario import Scenario, parse_scenario

CELLS = 200
MOST_OVERHEAD = 0.05  # s a cell
SPEED_UP = 1.7
HASHES = 350_000  # about a tenth of a second
SWEEP = """\
name: light
student: like_me
teachers: [{robot: crawler, gait: {kind: still}}]
sweep:
  over:
    teachers.all.scale: {uniform: [0.5, 1], steps: 20}
    rig.camera_noise: {uniform: [1, 10], steps: 10}
"""


def rows() -> list[Row]:
    """Every measurement of this file, as rows of benchmarks/results.json."""
    return [overhead(), two_cores()]


def overhead() -> Row:
    """From the first cell to the written verdicts.json, work that takes no time, in seconds a cell, against .05."""
    ours = np.array([_seconds(trivial, 1) / CELLS for _ in range(5)])
    return row("overhead a cell of a sweep", "target seconds", 1.0, np.full_like(ours, MOST_OVERHEAD), ours)


def two_cores() -> Row:
    """The same sweep in two processes against one, start-up and writing included."""
    compute = functools.partial(burning, HASHES)
    one, two = np.array([[_seconds(compute, workers) for workers in (1, 2)] for _ in range(3)]).T
    return row("a sweep on two cores", "one core", SPEED_UP, one, two)


def trivial(job: Job, progress: Progress) -> TrialResult:
    """Verdicts that follow from the job alone."""
    rng = np.random.default_rng([job.trial, *hashlib.sha256(job.cell.encode()).digest()[:4]])
    found = []
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
    hashlib.pbkdf2_hmac("sha256", b"work", b"", hashes)
    return trivial(job, progress)


def _sweep() -> Scenario:
    return parse_scenario(SWEEP)


def _seconds(compute: Compute, workers: int) -> float:
    scenario = _sweep()
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        outcome = run(scenario, out=Path(folder) / "run", workers=workers, compute=compute)
        seconds = time.perf_counter() - begin
    assert len(outcome.verdicts["cells"]) == CELLS
    return seconds
