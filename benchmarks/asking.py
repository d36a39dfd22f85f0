"""How fast do results answer? A query over ten thousand trials."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measure import Settings
from benchmarks.row import Row, within
from testbed.experiment.columns import SELVES, VERDICTS, Column
from testbed.experiment.query import ask
from testbed.experiment.record import TrialResult
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.trial_files import encode
from testbed.scenario import load_scenario, with_overrides

TRIALS, SECONDS = 10_000, 2.0
QUERY = "SELECT student, robot, avg((verdict = truth)::int), median(score) FROM verdicts GROUP BY ALL ORDER BY ALL"


def rows(settings: Settings) -> Iterator[Row]:
    """The same question again and again; the first time all files are read."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run"
        _write(path)
        answer, seconds = ask([path], QUERY), []
        for _ in range(settings.rounds):
            begin = time.perf_counter()
            again = ask([path], QUERY)
            seconds.append(time.perf_counter() - begin)
            assert again.rows == answer.rows
            assert len(again.rows) == 4
    yield within("a query over 10,000 trials", SECONDS, np.array(seconds), note="by the clock")


def _write(path: Path) -> None:
    """A run of invented trials: two minds, two teachers, every column filled; all trials have the same rows."""
    scenario = with_overrides(load_scenario("whom_to_imitate"), trials=TRIALS)
    with RunDirectory.prepare(path, scenario, dict):
        folder = path / "trials" / "default"
        folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    names = {"trial": 0, "cell": "default"}
    made: list[dict[str, Any]] = [
        {"kind": "self", **_values(SELVES, rng), **names, "student": student} for student in ("a", "b")
    ]
    made += [
        {"kind": "verdict", **_values(VERDICTS, rng), **names, "student": student, "robot": robot}
        for student in ("a", "b")
        for robot in ("crawler", "splayed")
    ]
    contents = encode(TrialResult(tuple(made), {}))[1]
    for trial in range(TRIALS):
        (folder / f"{trial}.parquet").write_bytes(contents)


def _values(columns: tuple[Column, ...], rng: np.random.Generator) -> dict[str, Any]:
    kinds: dict[str, Any] = {"text": "appropriate", "whole": 3, "flag": True}
    return {each.name: kinds.get(each.kind, float(rng.random())) for each in columns if each.name != "run"}
