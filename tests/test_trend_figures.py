"""Trends along the axes of space-filling sweeps follow the numbers, and say how sure they are."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from light_sweep import light

from testbed.experiment.executor import Progress
from testbed.experiment.jobs import Job
from testbed.experiment.record import TrialResult
from testbed.experiment.runner import run
from testbed.report.desk import Desk
from testbed.report.reading import read_run
from testbed.report.sweeps import sweeps
from testbed.report.trend_figures import trend_figure, trend_of
from testbed.scenario import Scenario, parse_scenario, sweep_of

TEXT = """
name: x
seed: 1
trials: {trials}
student: like_me
teachers: [{{robot: crawler, gait: {{kind: still}}}}]
sweep:
  design: {design}
  over:
    rig.camera_noise: {{uniform: [1, 5]}}
    teachers.all.distance: {{log_uniform: [0.5, 2]}}
    teachers.all.robot: [crawler, splayed]
"""


def swept(design: str = "{sobol: 32}", trials: int = 2) -> Scenario:
    return parse_scenario(TEXT.format(design=design, trials=trials))


def noise_fails(scenario: Scenario) -> object:
    points = sweep_of(scenario).blocks["sweep"].points
    noise = {point.cell: float(str(point.levels["camera_noise"])) for point in points}

    def compute(job: Job, progress: Progress) -> TrialResult:
        bad = noise.get(job.cell, 0) > 3
        rows = [
            {**row, "verdict": row["truth"] if (not bad or number) else "inappropriate"}
            for number, row in enumerate(light(job, progress).rows)
        ]
        return TrialResult(tuple(rows), {"noise": np.zeros(1)})

    return compute


def test_trends_show_along_which_axis_verdicts_fail(tmp_path: Path) -> None:
    scenario = swept()
    run(scenario, out=tmp_path, compute=noise_fails(scenario))  # type: ignore[arg-type]
    desk = Desk.of(read_run(tmp_path))
    page = sweeps(desk)
    assert "Right verdicts and scores along camera noise and distance and robot" in page
    assert sweeps(desk) == page
    assert (tmp_path / "figures" / "sweep-sweep.svg").is_file()
    block = sweep_of(scenario).blocks["sweep"]
    figure = trend_figure(block, desk.run.verdicts(student=desk.mind))
    assert figure is not None
    falls = []
    for left, right in zip(figure.axes[::2], figure.axes[1::2], strict=True):
        assert (left.get_ylabel(), right.get_ylabel()) == ("right verdicts", "score")
        lines = [
            line for line in left.get_lines() if line.get_linestyle() == "-" and len(line.get_xdata()) > 5
        ]
        falls += [line.get_ydata()[0] - line.get_ydata()[-1] for line in lines]
        controls = [line for line in left.get_lines() if line.get_markerfacecolor() == "none"]
        assert len(controls) == 1  # the control is a distance of its own, not one of the range's ends
    assert figure.axes[2].get_xscale() == "log"
    assert [label.get_text() for label in figure.axes[4].get_xticklabels()] == ["crawler", "splayed"]
    assert falls[0] == pytest.approx(0.5, abs=0.1)
    assert abs(falls[1]) < 0.3


def test_no_trend_without_a_space_filling_design_or_with_few_conditions(tmp_path: Path) -> None:
    few = swept("{latin_hypercube: 3}")
    run(few, out=tmp_path, compute=light)
    rows = read_run(tmp_path).verdicts(student="like_me")
    assert trend_figure(sweep_of(few).blocks["sweep"], rows) is None


def test_the_interval_covers_a_known_trend() -> None:
    rng = np.random.default_rng(0)
    covered = []
    for _ in range(40):
        places = np.repeat(rng.uniform(0, 1, 60), 2)
        cells, trials = np.repeat(np.arange(60), 2), np.tile([0, 1], 60)
        values = np.sin(2 * places) + rng.normal(0, 0.3, 120) + np.repeat(rng.normal(0, 0.2, 60), 2)
        trend = trend_of(places, values, cells, trials)
        inner = slice(5, -5)
        truth = np.sin(2 * trend.at)
        covered.append(((trend.low <= truth) & (truth <= trend.high))[inner].mean())
    assert np.mean(covered) > 0.9


def test_levels_have_their_means() -> None:
    places, values = np.array([0.0, 0, 1, 1]), np.array([1.0, 3, 5, 5])
    trend = trend_of(places, values, np.arange(4), np.zeros(4), [0.0, 1.0])
    assert trend.mean.tolist() == [2, 5]
    assert math.isclose(trend.high[1], 5)
    assert trend.low[0] < 2 < trend.high[0]
