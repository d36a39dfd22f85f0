"""Whole sweeps: a cell that breaks harms no other, and killed at any moment they end in the same bytes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from light_sweep import broken_in_places, light, light_sweep

from testbed.errors import UserError
from testbed.experiment.executor import Progress
from testbed.experiment.jobs import Job, jobs_of
from testbed.experiment.record import TrialResult
from testbed.experiment.runner import executor_for, run
from testbed.scenario import cell_names, check, parse_scenario

HERE = Path(__file__).parent
BROKEN, MISTAKEN = Job("scale_0.5+camera_noise_1", 0), Job("scale_1+camera_noise_1", 0)


class Counting:
    def __init__(self) -> None:
        self.jobs: list[Job] = []

    def __call__(self, job: Job, progress: Progress) -> TrialResult:
        self.jobs.append(job)
        return light(job, progress)


@pytest.mark.parametrize("workers", [1, 2])
def test_cells_that_break_are_recorded_and_tried_again_and_harm_no_other(
    tmp_path: Path, workers: int
) -> None:
    scenario = light_sweep(3, 2)
    whole = run(scenario, out=tmp_path / "whole", compute=light)
    outcome = run(scenario, out=tmp_path / "broken", workers=workers, compute=broken_in_places)
    assert set(outcome.failed) == {BROKEN, MISTAKEN}
    errors = tmp_path / "broken" / "trials"
    assert "ZeroDivisionError: no such luck" in (errors / BROKEN.cell / "0.error.txt").read_text()
    assert (errors / MISTAKEN.cell / "0.error.txt").read_text().startswith("light.yaml:4: it does not fit")
    cells = {row["cell"] for row in outcome.verdicts["verdicts"]}
    assert len(cells) == len(jobs_of(scenario)) - 2
    for cell in cells:
        assert outcome.verdicts["cells"][cell] == whole.verdicts["cells"][cell]
    again = Counting()
    assert not run(scenario, out=tmp_path / "broken", compute=again).failed
    assert set(again.jobs) == {BROKEN, MISTAKEN}
    assert _bytes(tmp_path / "broken") == _bytes(tmp_path / "whole")
    assert not list(errors.rglob("*.error.txt"))


def test_a_sweep_may_leave_out_what_cannot_be(tmp_path: Path) -> None:
    outcome = run(light_sweep(3, 2, impossible="leave_out"), out=tmp_path, compute=broken_in_places)
    assert outcome.failed == (BROKEN,)
    assert outcome.left_out == (MISTAKEN,)


def test_verdicts_say_what_the_cells_are(tmp_path: Path) -> None:
    outcome = run(light_sweep(2, 2, trials=2), out=tmp_path, compute=light)
    written = json.loads((tmp_path / "verdicts.json").read_text())
    assert written["sweep"] == outcome.verdicts["sweep"]
    assert len(written["sweep"]) == 5
    assert written["sweep"][1] == {
        "cell": "scale_0.5+camera_noise_1",
        "block": "sweep",
        "control": "control",
        "levels": {"scale": 0.5, "camera_noise": 1},
    }


def test_an_executor_is_chosen_by_name() -> None:
    with pytest.raises(UserError, match=r"no executor 'rai'; did you mean 'ray'\?"):
        executor_for(2, "rai")
    with pytest.raises(UserError, match="have no address; add '--executor ray'"):
        executor_for(2, "processes", "127.0.0.1:6379")


def test_two_hundred_cells_killed_five_times_over_end_in_the_same_bytes(tmp_path: Path) -> None:
    scenario, out = light_sweep(), tmp_path / "killed"
    run(scenario, out=tmp_path / "whole", compute=light)
    rng = np.random.default_rng(int.from_bytes(os.urandom(4)))
    counts = []
    for workers in (1, 2, 1, 2, 1):
        process = _start(out, workers)
        before = len(list(out.glob("trials/*/*.parquet")))
        target = before + int(rng.integers(1, 30))
        deadline = time.monotonic() + 120
        while process.poll() is None and len(list(out.glob("trials/*/*.parquet"))) < target:
            assert time.monotonic() < deadline, "it took too long"
            time.sleep(0.005)
        time.sleep(float(rng.uniform(0, 0.02)))
        process.send_signal(signal.SIGKILL)
        _, complaints = process.communicate(timeout=60)
        assert process.returncode == -signal.SIGKILL, complaints
        counts.append(len(list(out.glob("trials/*/*.parquet"))))
    assert counts == sorted(counts)
    assert counts[0] >= 1
    assert counts[-1] < 200
    left = Counting()
    outcome = run(scenario, out=out, compute=left)
    assert not outcome.failed
    assert (
        len(left.jobs) == len(set(left.jobs)) <= 200 - counts[-1] + 1
    )  # one may have lost only its last rename
    assert len(outcome.verdicts["verdicts"]) == 2 * 200
    assert _bytes(out) == _bytes(tmp_path / "whole")
    assert not list(out.rglob("*.tmp"))


def _start(out: Path, workers: int) -> subprocess.Popen[str]:
    command = [sys.executable, str(HERE / "light_sweep.py"), str(out), str(workers)]
    path = os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path}
    return subprocess.Popen(command, text=True, stderr=subprocess.PIPE, env=environment)


def _bytes(folder: Path) -> bytes:
    return (folder / "verdicts.json").read_bytes()


def test_the_sweep_of_the_documentation_can_be_run() -> None:
    text = (HERE.parent / "docs" / "sweeps.md").read_text(encoding="utf-8")
    block = text[text.index("    trials: 20") : text.index("`testbed check FILE`")]
    scenario = parse_scenario(textwrap.dedent(block), "sweeps.md")
    check(scenario)
    assert len(cell_names(scenario)) == 3 * 5  # one of them is the control
