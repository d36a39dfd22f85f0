"""Small trials for tests of what is around trials."""

from __future__ import annotations

import numpy as np

from testbed.experiment.executor import Progress
from testbed.experiment.jobs import Job
from testbed.experiment.record import Row, TrialResult
from testbed.scenario import Scenario, load_scenario, with_overrides


def scenario_of(trials: int, seed: int = 5) -> Scenario:
    return with_overrides(load_scenario("whom_to_imitate"), trials=trials, seed=seed)


def trial_result(trial: int, size: int = 200) -> TrialResult:
    """Deterministic; scores mostly right, one row with a score missing for every fifth trial."""
    rng = np.random.default_rng(trial)
    rows: list[Row] = []
    for index, truth in enumerate(("appropriate", "inappropriate")):
        score = float(rng.normal(1.0 - index))
        row: Row = {
            "trial": trial,
            "cell": "default",
            "student": "paper",
            "teacher": f"teacher_{index}",
            "robot": "crawler" if index == 0 else "splayed",
            "truth": truth,
            "verdict": "appropriate" if score > 0.5 else "inappropriate",
            "score": None if index and trial % 5 == 4 else score,
            "score_low": None,
            "score_high": None,
            "found": True,
            "chosen": index == 0,
            "initial_error": float(rng.uniform(1, 2)),
            "final_error": float(rng.uniform(0, 1)),
        }
        rows.append(row)
    arrays = {
        "self/error": rng.normal(size=size),
        "teacher_0/images": rng.integers(0, 256, size=(3, 2, 5, 4), dtype=np.uint8),
        "perform/start_step": np.array(trial),
        "flag": np.array([True, False]),
    }
    return TrialResult(rows=tuple(rows), arrays=arrays)


def compute(job: Job, progress: Progress) -> TrialResult:
    for done in range(3):
        progress("self-discovery", done + 1, 3)
    return trial_result(job.trial)


def assert_same(one: TrialResult, two: TrialResult) -> None:
    assert list(one.rows) == list(two.rows)
    assert list(one.arrays) == list(two.arrays)
    for name, array in one.arrays.items():
        np.testing.assert_array_equal(array, two.arrays[name])
        assert array.dtype == two.arrays[name].dtype
