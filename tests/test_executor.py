"""Executors: every job is computed once, and losing a worker loses nothing else."""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from trial_builder import compute, trial_result

from testbed.errors import UserError
from testbed.experiment.executor import Executor, InProcessExecutor, Progress
from testbed.experiment.jobs import Job
from testbed.experiment.process_executor import ProcessExecutor
from testbed.experiment.record import TrialResult

ROOT = Path(__file__).resolve().parents[1]
JOBS = tuple(Job("default", trial) for trial in range(5))
both = pytest.mark.parametrize("executor", [InProcessExecutor(), ProcessExecutor(2)], ids=["in", "processes"])


@dataclass
class Heard:
    results: dict[Job, TrialResult] = field(default_factory=dict)
    failures: dict[Job, tuple[str, str]] = field(default_factory=dict)
    progress: list[tuple[Job, str, int, int]] = field(default_factory=list)

    def progressed(self, job: Job, phase: str, done: int, total: int) -> None:
        self.progress.append((job, phase, done, total))

    def finished(self, job: Job, result: TrialResult) -> None:
        assert job not in self.results
        self.results[job] = result

    def mistaken(self, job: Job, error: UserError) -> None:
        raise error

    def failed(self, job: Job, why: str, details: str) -> None:
        assert job not in self.failures
        self.failures[job] = (why, details)


@both
def test_every_job_is_computed_once(executor: Executor) -> None:
    heard = Heard()
    executor.run(JOBS, compute, heard)
    assert set(heard.results) == set(JOBS)
    assert all(
        list(result.rows) == list(trial_result(job.trial).rows) for job, result in heard.results.items()
    )
    assert not heard.failures
    for job in JOBS:
        mine = [rest for other, *rest in heard.progress if other == job]
        assert mine[0] == ["self-discovery", 1, 3]
        assert mine[-1] == ["self-discovery", 3, 3]


@both
def test_nothing_to_do_is_done_at_once(executor: Executor) -> None:
    executor.run((), compute, Heard())


def fails(job: Job, progress: Progress) -> TrialResult:
    if job.trial == 2:
        raise ZeroDivisionError("the pan\nis stuck")
    return trial_result(job.trial)


@both
def test_a_trial_that_raises_has_failed_and_the_others_go_on(executor: Executor) -> None:
    heard = Heard()
    executor.run(JOBS, fails, heard)
    assert set(heard.results) == set(JOBS) - {JOBS[2]}
    why, details = heard.failures[JOBS[2]]
    assert why == "ZeroDivisionError: the pan is stuck"
    assert "Traceback" in details
    assert "in fails" in details


def mistaken(job: Job, progress: Progress) -> TrialResult:
    if job.trial == 2:
        raise UserError("the episode is too short", "raise world.max_cycles", file="x.yaml", line=3)
    return trial_result(job.trial)


@both
def test_a_users_mistake_ends_everything_at_once(executor: Executor) -> None:
    heard = Heard()
    with pytest.raises(UserError) as caught:
        executor.run(JOBS, mistaken, heard)
    assert str(caught.value) == "x.yaml:3: the episode is too short; raise world.max_cycles"
    assert not heard.failures
    # A second worker may still be starting while the first one does trial 1 and comes upon trial 2.
    assert set(JOBS[:2]) & set(heard.results)
    assert JOBS[2] not in heard.results


def test_after_a_users_mistake_no_other_trial_is_begun() -> None:
    begun = []

    def noted(job: Job, progress: Progress) -> TrialResult:
        begun.append(job)
        return mistaken(job, progress)

    with pytest.raises(UserError):
        InProcessExecutor().run(JOBS, noted, Heard())
    assert begun == list(JOBS[:3])


def dies(folder: Path, times: int, job: Job, progress: Progress) -> TrialResult:
    deaths = len(list(folder.iterdir()))
    if job.trial == 1 and deaths < times:
        (folder / str(deaths)).touch()
        progress("self-discovery", 0, 3)
        os.kill(os.getpid(), signal.SIGKILL)
    return trial_result(job.trial)


def test_the_trial_of_a_killed_worker_is_tried_once_more(tmp_path: Path) -> None:
    heard = Heard()
    ProcessExecutor(2).run(JOBS, functools.partial(dies, tmp_path, 1), heard)
    assert set(heard.results) == set(JOBS)
    assert not heard.failures


def test_a_trial_that_kills_its_worker_twice_has_failed(tmp_path: Path) -> None:
    heard = Heard()
    ProcessExecutor(2).run(JOBS, functools.partial(dies, tmp_path, 99), heard)
    assert set(heard.results) == set(JOBS) - {JOBS[1]}
    assert "killed by SIGKILL" in heard.failures[JOBS[1]][0]
    assert len(list(tmp_path.iterdir())) == 2


def leaves(job: Job, progress: Progress) -> TrialResult:
    os._exit(3)


def test_a_worker_that_ends_by_itself_is_noticed() -> None:
    heard = Heard()
    ProcessExecutor(1).run(JOBS[:1], leaves, heard)
    assert "status 3" in heard.failures[JOBS[0]][0]


def slow(folder: Path, job: Job, progress: Progress) -> TrialResult:
    if job.trial:
        (folder / str(os.getpid())).touch()
        time.sleep(60)
    else:  # the first to finish waits until the other is under way
        while not list(folder.iterdir()):
            time.sleep(0.01)
    return trial_result(job.trial)


class FullDisk(Heard):
    def finished(self, job: Job, result: TrialResult) -> None:
        raise UserError("the disk is full")


def test_when_the_listener_gives_up_no_worker_stays(tmp_path: Path) -> None:
    began = time.monotonic()
    with pytest.raises(UserError, match="full"):
        ProcessExecutor(2).run(JOBS, functools.partial(slow, tmp_path), FullDisk())
    assert time.monotonic() - began < 20
    assert gone(pids(tmp_path))


class Patient(Heard):
    """Writes the first result down only when another job has begun."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.folder = folder

    def finished(self, job: Job, result: TrialResult) -> None:
        super().finished(job, result)
        if len(self.results) == 1:
            wait_until(lambda: len(list(self.folder.iterdir())) == 2)


def noted(folder: Path, job: Job, progress: Progress) -> TrialResult:
    (folder / str(job.trial)).touch()
    return trial_result(job.trial)


def test_no_worker_waits_until_its_last_result_is_written(tmp_path: Path) -> None:
    heard = Patient(tmp_path)
    ProcessExecutor(1).run(JOBS, functools.partial(noted, tmp_path), heard)
    assert set(heard.results) == set(JOBS)


def test_workers_load_only_what_computes() -> None:
    loads = (
        "import testbed.experiment.life, testbed.experiment.process_executor, testbed.experiment.trial, sys"
    )
    slow_ones = ("scipy.stats", "pyarrow", "matplotlib", "duckdb", "rich")
    script = f"{loads}\nprint([name for name in {slow_ones} if name in sys.modules])"
    said = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert said.stdout.strip() == "[]"


PARENT = """
import functools, sys
from pathlib import Path
import test_executor as t
from testbed.experiment.process_executor import ProcessExecutor
if __name__ == "__main__":
    ProcessExecutor(2).run(t.JOBS[1:], functools.partial(t.slow, Path(sys.argv[1])), t.Heard())
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_workers_die_with_the_process_that_started_them(tmp_path: Path, number: signal.Signals) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT)
    marks = tmp_path / "marks"
    marks.mkdir()
    path = os.pathsep.join((str(ROOT), str(ROOT / "tests")))
    parent = subprocess.Popen(
        [sys.executable, str(script), str(marks)], env={**os.environ, "PYTHONPATH": path}
    )
    try:
        wait_until(lambda: len(pids(marks)) == 2)
    finally:
        parent.send_signal(number)
        parent.wait()
    wait_until(lambda: gone(pids(marks)))


def test_there_must_be_a_worker() -> None:
    with pytest.raises(ValueError, match="at least one"):
        ProcessExecutor(0)


def pids(folder: Path) -> list[int]:
    return [int(path.name) for path in folder.iterdir()]


def gone(numbers: list[int]) -> bool:
    return not any(_is_running(number) for number in numbers)


def _is_running(number: int) -> bool:
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):
        return False
    return state != "Z"  # a dead child of a dead parent may wait to be buried


def wait_until(condition: object, seconds: float = 30) -> None:
    deadline = time.monotonic() + seconds
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < deadline, "it took too long"
        time.sleep(0.02)
