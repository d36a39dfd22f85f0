"""What the page says of a sweep follows from its numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from light_sweep import light, light_sweep

from testbed.errors import UserError
from testbed.experiment.executor import Progress
from testbed.experiment.jobs import Job
from testbed.experiment.record import TrialResult
from testbed.experiment.runner import run
from testbed.report.desk import Desk
from testbed.report.reading import read_run
from testbed.report.sweeps import sweeps
from testbed.scenario import Scenario, parse_scenario, sweep_of


def judged(job: Job, *, right: bool) -> TrialResult:
    """All verdicts right, or all wrong."""
    rows = []
    for number, row in enumerate(light(job, lambda phase, done, total: None).rows):
        truth = str(row["truth"])
        verdict = truth if right else {"appropriate": "inappropriate"}.get(truth, "appropriate")
        rows.append({**row, "verdict": verdict, "score": (1.0 - number) * (1 if right else -1)})
    return TrialResult(rows=tuple(rows), arrays={"noise": np.zeros(1)})


def large_fail(job: Job, progress: Progress) -> TrialResult:
    if job.cell == "scale_0.5+camera_noise_10":
        raise UserError("it is too small to be seen", "go nearer", file="x.yaml", line=3)
    return judged(job, right="camera_noise_10" not in job.cell)


def section(scenario: Scenario, out: Path, compute: object = large_fail) -> str:
    run(scenario, out=out, compute=compute)  # type: ignore[arg-type]
    return sweeps(Desk.of(read_run(out)))


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    out = tmp_path_factory.mktemp("sweep")
    scenario = light_sweep(2, 2, trials=25, impossible="leave_out")
    return section(scenario, out), out


def test_it_tells_what_holds_and_what_does_not(told: tuple[str, Path]) -> None:
    page, out = told
    assert "Does it hold elsewhere?" in page
    assert "does not hold" in page
    assert "at scale 1, camera noise 10" in page or "at camera noise 10" in page
    assert "1 condition cannot be: scale 0.5, camera noise 10. E.g.: it is too small to be seen." in page
    assert (out / "figures" / "sweep-sweep.svg").is_file()
    narrow = re.search(r"<td>(.0\.\d{3})<br><small>(.0\.\d{3} to .0\.\d{3})</small></td>", page)
    assert narrow, "intervals of differences stand below them"


def test_it_does_not_claim_what_few_trials_cannot_show(tmp_path: Path) -> None:
    page = section(light_sweep(2, 2, trials=4), tmp_path, lambda job, progress: judged(job, right=True))
    assert "cannot tell at this N" in page
    assert "does not hold</span>" not in page
    assert "trials a condition would tell" in page


def test_it_is_the_same_again(told: tuple[str, Path]) -> None:
    page, out = told
    assert sweeps(Desk.of(read_run(out))) == page


@pytest.mark.parametrize("design", ["axes", "{sobol: 5}"])
def test_other_designs_are_told_too(design: str, tmp_path: Path) -> None:
    scenario = parse_scenario(
        "name: x\nseed: 1\ntrials: 3\nstudent: like_me\nsplits: {held_out: {seed: 9}}\n"
        "teachers: [{robot: crawler, gait: {kind: still}}]\n"
        f"sweep: {{design: {design}, over: {{rig.camera_noise: {{uniform: [1, 5], steps: 3}}, "
        "teachers.all.scale: [0.5, 1]}}\n"
    )
    page = section(scenario, tmp_path, light)
    for point in sweep_of(scenario).blocks["sweep"].points:
        assert f"<td>{point.levels['scale']}</td>" in page
    assert "teachers of the split <em>development</em>" in page


def test_a_run_without_a_sweep_has_no_such_section(tmp_path: Path) -> None:
    scenario = parse_scenario(
        "name: x\nstudent: like_me\nteachers: [{robot: crawler, gait: {kind: still}}]\n"
    )
    assert section(scenario, tmp_path, light) == ""
