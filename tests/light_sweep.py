"""A sweep of 200 cells whose trials cost next to nothing, for tests of what is around them; also a command."""

from __future__ import annotations

import hashlib
import sys
import time
from pathlib import Path

import numpy as np

from testbed.errors import UserError
from testbed.experiment.executor import Progress
from testbed.experiment.jobs import Job
from testbed.experiment.record import Row, TrialResult
from testbed.scenario import Scenario, parse_scenario

TEXT = """\
name: light
seed: 3
trials: {trials}
student: like_me
teachers:
  - {{robot: crawler, gait: {{kind: still}}}}
sweep:
  design: grid
  over:
    teachers.all.scale: {{uniform: [0.5, 1], steps: {columns}}}
    rig.camera_noise: {{uniform: [1, 10], steps: {rows}}}
  impossible: {impossible}
"""


def light_sweep(columns: int = 20, rows: int = 10, trials: int = 1, impossible: str = "fail") -> Scenario:
    return parse_scenario(
        TEXT.format(columns=columns, rows=rows, trials=trials, impossible=impossible), "light.yaml"
    )


def light(job: Job, progress: Progress) -> TrialResult:
    """Scores that follow from the job alone."""
    rng = np.random.default_rng([job.trial, *hashlib.sha256(job.cell.encode()).digest()[:4]])
    rows: list[Row] = []
    for index, truth in enumerate(("appropriate", "inappropriate")):
        score = float(rng.normal(1.0 - index))
        verdict = "appropriate" if score > 0.5 else "inappropriate"
        names = {"cell": job.cell, "trial": job.trial, "student": "like_me", "teacher": f"teacher_{index}"}
        judged = {"robot": "crawler", "truth": truth, "verdict": verdict, "score": score}
        rows.append(
            {**names, **judged, "score_low": None, "score_high": None, "found": True, "chosen": False}
        )
    return TrialResult(rows=tuple(rows), arrays={"noise": rng.normal(size=50)})


def slow(job: Job, progress: Progress) -> TrialResult:
    """A little longer, so that something can happen meanwhile."""
    time.sleep(0.01)
    return light(job, progress)


def broken_in_places(job: Job, progress: Progress) -> TrialResult:
    """One cell crashes, one is a mistake of the user's."""
    if job.cell == "scale_0.5+camera_noise_1":
        raise ZeroDivisionError("no such luck")
    if job.cell == "scale_1+camera_noise_1":
        raise UserError("it does not fit", "make it smaller", file="light.yaml", line=4)
    return light(job, progress)


if __name__ == "__main__":
    from testbed.experiment.runner import run

    run(light_sweep(), out=Path(sys.argv[1]), workers=int(sys.argv[2]), compute=slow)
