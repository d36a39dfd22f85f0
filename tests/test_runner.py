"""Whole runs: continued, killed and repaired, they end in the same bytes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from trial_builder import compute, scenario_of, trial_result

from testbed.errors import UserError
from testbed.experiment import verdicts
from testbed.experiment.executor import Progress
from testbed.experiment.jobs import Job, jobs_of
from testbed.experiment.record import TrialResult
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.runner import Quiet, run, summed_up

ROOT = Path(__file__).resolve().parents[1]
QUICK = """\
seed: 6
student: like_me
rig: {camera_rate: 5, supersample: 1}
teachers:
  - {robot: crawler, gait: crawl, distance: 0.9, bearing_deg: -30}
"""


class Told(Quiet):
    def __init__(self) -> None:
        self.notices: list[str] = []
        self.failures: list[tuple[Job, str, Path]] = []
        self.begun: tuple[int, int] = (0, 0)

    def started(self, path: Path, total: int, finished: int) -> None:
        self.begun = (total, finished)

    def failed(self, job: Job, why: str, file: Path) -> None:
        self.failures.append((job, why, file))

    def notice(self, text: str) -> None:
        self.notices.append(text)


class Counting:
    """Computes trials and remembers which."""

    def __init__(self, broken: tuple[int, ...] = ()) -> None:
        self.trials: list[int] = []
        self.broken = broken

    def __call__(self, job: Job, progress: Progress) -> TrialResult:
        self.trials.append(job.trial)
        if job.trial in self.broken:
            raise RuntimeError("servo on fire")
        return trial_result(job.trial)


def test_a_run_ends_in_verdicts_json(tmp_path: Path) -> None:
    outcome = run(scenario_of(3), out=tmp_path / "run", compute=compute)
    written = json.loads((tmp_path / "run" / "verdicts.json").read_text())
    assert [row["trial"] for row in written["verdicts"]] == [0, 0, 1, 1, 2, 2]
    assert written["summary"]["paper"]["n"] == 6
    assert outcome.path == tmp_path / "run"
    assert not outcome.failed
    assert verdicts.text(outcome.verdicts) == (tmp_path / "run" / "verdicts.json").read_text()


def test_the_number_of_workers_does_not_show(tmp_path: Path) -> None:
    for workers in (1, 2):
        run(scenario_of(5), out=tmp_path / str(workers), workers=workers, compute=compute)
    for name in ("verdicts.json", "trials/default/4.npz", "trials/default/4.parquet"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "2" / name).read_bytes()


def test_a_run_continues_and_trials_is_the_total(tmp_path: Path) -> None:
    counting, told = Counting(), Told()
    run(scenario_of(2), out=tmp_path / "run", compute=counting)
    run(scenario_of(5), out=tmp_path / "run", compute=counting, display=told)
    run(scenario_of(5), out=tmp_path / "run", compute=counting)
    assert counting.trials == [0, 1, 2, 3, 4]
    assert told.begun == (5, 2)
    run(scenario_of(5), out=tmp_path / "at_once", compute=compute)
    assert _verdicts(tmp_path / "run") == _verdicts(tmp_path / "at_once")


def test_fewer_trials_lose_nothing(tmp_path: Path) -> None:
    counting = Counting()
    run(scenario_of(5), out=tmp_path, compute=counting)
    run(scenario_of(2), out=tmp_path, compute=counting)
    run(scenario_of(2), out=tmp_path / "two", compute=compute)
    assert _verdicts(tmp_path) == _verdicts(tmp_path / "two")
    run(scenario_of(5), out=tmp_path, compute=counting)
    assert len(counting.trials) == 5


def test_a_failed_trial_is_told_kept_and_tried_again(tmp_path: Path) -> None:
    told = Told()
    outcome = run(scenario_of(3), out=tmp_path, compute=Counting(broken=(1,)), display=told)
    error = tmp_path / "trials/default/1.error.txt"
    assert outcome.failed == (Job("default", 1),)
    assert told.failures == [(Job("default", 1), "RuntimeError: servo on fire", error)]
    assert "servo on fire" in error.read_text()
    assert [row["trial"] for row in outcome.verdicts["verdicts"]] == [0, 0, 2, 2]
    again = Counting()
    assert not run(scenario_of(3), out=tmp_path, compute=again).failed
    assert again.trials == [1]
    assert not error.exists()


def mistaken(job: Job, progress: Progress) -> TrialResult:
    if job.trial == 2:
        raise UserError("the episode is too short", "raise world.max_cycles", file="x.yaml", line=3)
    return trial_result(job.trial)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_users_mistake_in_a_trial_ends_the_run_and_keeps_what_is_finished(
    tmp_path: Path, workers: int
) -> None:
    told = Told()
    with pytest.raises(UserError, match=r"^x.yaml:3: the episode is too short; raise world.max_cycles$"):
        run(scenario_of(9), out=tmp_path, workers=workers, compute=mistaken, display=told)
    assert not told.failures
    assert not list(tmp_path.rglob("*.error.txt"))
    finished = RunDirectory.open(tmp_path).finished(jobs_of(scenario_of(9)), pytest.fail)
    # A second worker may still be starting while the first one does trial 1 and comes upon trial 2.
    assert {Job("default", 0), Job("default", 1)} & finished
    assert Job("default", 2) not in finished
    assert len(finished) < 8


def test_a_damaged_trial_is_computed_again(tmp_path: Path) -> None:
    run(scenario_of(3), out=tmp_path, compute=compute)
    before = _verdicts(tmp_path)
    victim = tmp_path / "trials/default/1.npz"
    victim.write_bytes(victim.read_bytes()[:-7])
    counting, told = Counting(), Told()
    run(scenario_of(3), out=tmp_path, compute=counting, display=told)
    assert counting.trials == [1]
    assert len(told.notices) == 1
    assert "trial 1" in told.notices[0]
    assert _verdicts(tmp_path) == before


def test_a_place_that_cannot_be_written_is_told_before_anything_is_computed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    counting = Counting()
    with pytest.raises(UserError):
        run(scenario_of(3), out=tmp_path / "file", compute=counting)
    assert not counting.trials


def test_source_that_has_changed_is_told(tmp_path: Path) -> None:
    run(scenario_of(1), out=tmp_path, compute=compute)
    file = tmp_path / "provenance.json"
    file.write_text(
        json.dumps({**json.loads(file.read_text()), "source": {"commit": "0" * 40, "modified": False}})
    )
    told = Told()
    run(scenario_of(2), out=tmp_path, compute=compute, display=told)
    assert any("another version" in notice for notice in told.notices)


def test_the_provenance_names_neither_people_nor_places(tmp_path: Path) -> None:
    run(scenario_of(1), out=tmp_path, compute=compute)
    text = (tmp_path / "provenance.json").read_text()
    record = json.loads(text)
    assert record["seed"] == 5
    assert record["physics"]["renderer"] == "TinyRenderer"
    assert record["packages"]["numpy"]
    assert record["machine"]["cores"] >= 1
    assert str(Path.home()) not in text
    assert str(ROOT) not in text
    assert os.uname().nodename not in text


# From here on the real command runs, killed and stopped while it computes.


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scenario of a few seconds."""
    folder = tmp_path_factory.mktemp("scenarios")
    (folder / "quick.yaml").write_text(QUICK)
    return folder


def start(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "testbed", "run", "quick.yaml", "--smoke", *arguments],
        cwd=folder,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,  # a process group of its own, to be stopped as a terminal would
        # A shell's background jobs are deaf to Ctrl-C, and would pass that on.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


@pytest.fixture(scope="module")
def reference(quick: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The real command, undisturbed."""
    out = tmp_path_factory.mktemp("reference") / "run"
    process = start(quick, "--trials", "3", "--workers", "2", "--out", str(out))
    _, complaints = process.communicate(timeout=300)
    assert process.returncode == 0, complaints
    return out


def test_the_real_command_writes_verdicts_and_a_report(reference: Path) -> None:
    contents = json.loads(_verdicts(reference))
    assert [(row["trial"], row["student"]) for row in contents["verdicts"]] == [
        (trial, "like_me") for trial in range(3)
    ]
    assert len(contents["selves"]) == 3
    for row in contents["verdicts"]:
        assert {"teacher", "robot", "truth", "verdict", "score"} <= set(row)
        assert {row["truth"], row["verdict"]} <= {"appropriate", "inappropriate"}
    assert (reference / "report.html").stat().st_size > 10_000
    assert summed_up(RunDirectory.open(reference))["hash"] == contents["hash"]


def test_killed_half_way_and_started_again_it_ends_in_the_same_bytes(
    quick: Path, reference: Path, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    process = start(quick, "--trials", "3", "--workers", "2", "--out", str(out))
    _wait_until(lambda: list(out.glob("trials/default/*.parquet")), process)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=60)
    kept = len(list(out.glob("trials/default/*.parquet")))
    assert 1 <= kept < 3
    again = start(quick, "--trials", "3", "--workers", "1", "--out", str(out))
    said, complaints = again.communicate(timeout=300)
    assert again.returncode == 0, complaints
    assert f"{kept} of 3 trials are finished" in said
    assert _verdicts(out) == _verdicts(reference)


def test_ctrl_c_says_how_to_continue_and_loses_nothing(quick: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    process = start(quick, "--trials", "40", "--workers", "2", "--out", str(out))
    _wait_until(lambda: list(out.glob("trials/default/*.parquet")), process)
    os.killpg(process.pid, signal.SIGINT)
    _, complaints = process.communicate(timeout=60)
    assert process.returncode == 130, complaints
    last = complaints.strip().splitlines()[-1]
    told = "testbed: stopped; what is finished is kept, continue with: testbed run quick.yaml --smoke"
    assert last.startswith(told)
    assert "Traceback" not in complaints
    scenario = RunDirectory.open(out).scenario
    finished = [job for job in jobs_of(scenario) if (out / f"trials/default/{job.trial}.parquet").exists()]
    assert finished
    assert RunDirectory.open(out).finished(jobs_of(scenario), pytest.fail) == set(finished)
    assert not list(out.rglob("*.tmp"))


def _verdicts(run_directory: Path) -> bytes:
    return (run_directory / "verdicts.json").read_bytes()


def _wait_until(condition: Callable[[], object], process: subprocess.Popen[str]) -> None:
    deadline = time.monotonic() + 200
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.02)
