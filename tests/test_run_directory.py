"""Run directories: whole or not at all, continued, locked, and never mistaken for one another."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from trial_builder import assert_same, scenario_of, trial_result

from testbed.errors import UserError
from testbed.experiment.jobs import Job, jobs_of
from testbed.experiment.run_directory import RunDirectory, default_path
from testbed.experiment.trial_files import decode
from testbed.resources import robot_path
from testbed.scenario import Scenario, check, content_hash, load_scenario, resolve

ROOT = Path(__file__).resolve().parents[1]
JOB = Job("default", 0)


def filled(path: Path, trials: int = 3) -> RunDirectory:
    scenario = scenario_of(trials)
    with RunDirectory.prepare(path, scenario, dict) as run:
        for job in jobs_of(scenario):
            run.write_trial(job, trial_result(job.trial))
    return run


def test_a_trial_comes_back_as_it_was(tmp_path: Path) -> None:
    run = RunDirectory.open(filled(tmp_path / "run").path)
    for job in jobs_of(run.scenario):
        files = [run.path / f"trials/default/{job.trial}{suffix}" for suffix in (".npz", ".parquet")]
        assert_same(decode(*(file.read_bytes() for file in files)), trial_result(job.trial))
        assert list(run.read_rows(job)) == list(trial_result(job.trial).rows)


def test_columns_keep_their_type_where_every_value_is_missing(tmp_path: Path) -> None:
    filled(tmp_path, 1)
    schema = pq.read_schema(tmp_path / "trials/default/0.parquet")
    assert str(schema.field("score_low").type) == "double"
    assert str(schema.field("trial").type) == "int64"
    assert str(schema.field("found").type) == "bool"


def test_a_new_directory_says_what_it_is(tmp_path: Path) -> None:
    scenario = scenario_of(2)
    with RunDirectory.prepare(tmp_path / "a" / "b", scenario, lambda: {"seed": 5}) as run:
        assert (run.path / "scenario.resolved.yaml").read_text() == resolve(scenario)
    provenance = json.loads((run.path / "provenance.json").read_text())
    assert provenance == {"scenario": "whom_to_imitate", "hash": content_hash(scenario), "seed": 5}
    assert RunDirectory.open(run.path).hash8 == content_hash(scenario) == run.hash8
    assert default_path(scenario) == Path("runs") / f"whom_to_imitate-{content_hash(scenario)}"


def with_own_robots(folder: Path, student: str = "crawler", teacher: str = "splayed") -> Scenario:
    """A scenario in ``folder/x.yaml`` whose robots are files of one's own: a/mine.yaml and b/<teacher>.yaml."""
    places = {"a/mine.yaml": student, f"b/{teacher}.yaml": teacher}
    for place, robot in places.items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        (folder / place).write_bytes(robot_path("crawler" if robot == "mine" else robot).read_bytes())
    (folder / "x.yaml").write_text(
        f"student: {{robot: a/mine.yaml}}\nteachers:\n- {{robot: b/{teacher}.yaml, gait: still}}\n"
        "- {robot: crawler, gait: still, bearing_deg: 60}\n"
    )
    return load_scenario(folder / "x.yaml")


def test_robots_of_ones_own_are_kept_with_the_run(tmp_path: Path) -> None:
    scenario = with_own_robots(tmp_path / "home")
    before = content_hash(scenario)
    with RunDirectory.prepare(tmp_path / "run", scenario, dict) as run:
        assert run.hash8 == before
    shutil.rmtree(tmp_path / "home")
    (tmp_path / "run").rename(tmp_path / "moved")
    assert str(tmp_path) not in (tmp_path / "moved/scenario.resolved.yaml").read_text()
    kept = RunDirectory.open(tmp_path / "moved").scenario
    assert content_hash(kept) == before
    check(kept)
    assert kept.student.robot == str(tmp_path / "moved/robots/mine.yaml")
    assert kept.teachers[1].robot == "crawler"
    with RunDirectory.prepare(tmp_path / "moved", kept, dict) as run:  # run from its own folder
        assert run.hash8 == before
    (tmp_path / "moved/provenance.json").unlink()
    with RunDirectory.prepare(tmp_path / "moved", kept, dict) as run:
        assert run.hash8 == before


def test_two_robots_of_one_file_name_are_refused_unless_they_are_the_same(tmp_path: Path) -> None:
    alike = with_own_robots(tmp_path / "alike", teacher="mine")
    with RunDirectory.prepare(tmp_path / "run", alike, dict):
        assert [path.name for path in (tmp_path / "run/robots").iterdir()] == ["mine.yaml"]
    different = with_own_robots(tmp_path / "different", teacher="mine", student="splayed")
    with (
        pytest.raises(UserError, match=r"files named 'mine.yaml'; rename"),
        RunDirectory.prepare(tmp_path / "other", different, dict),
    ):
        pytest.fail("it was let in")
    assert not (tmp_path / "other/robots").exists()


def test_provenance_is_written_once_and_the_number_of_trials_follows(tmp_path: Path) -> None:
    filled(tmp_path, 2)
    before = (tmp_path / "provenance.json").read_bytes()
    with RunDirectory.prepare(tmp_path, scenario_of(4), lambda: {"seed": 99}) as run:
        finished = run.finished(jobs_of(scenario_of(4)), pytest.fail)
    assert finished == {Job("default", 0), Job("default", 1)}
    assert (tmp_path / "provenance.json").read_bytes() == before
    assert RunDirectory.open(tmp_path).scenario.trials == 4


def test_another_scenario_or_seed_is_refused_and_harms_nothing(tmp_path: Path) -> None:
    filled(tmp_path, 1)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    with (
        pytest.raises(UserError, match=r"another scenario or seed.*--out"),
        RunDirectory.prepare(tmp_path, scenario_of(1, seed=6), dict),
    ):
        pytest.fail("it was let in")
    assert before == {path: path.read_bytes() for path in before}


def test_another_scenario_is_refused_also_where_provenance_was_never_written(tmp_path: Path) -> None:
    filled(tmp_path, 1)
    (tmp_path / "provenance.json").unlink()
    with (
        pytest.raises(UserError, match="another scenario"),
        RunDirectory.prepare(tmp_path, scenario_of(1, seed=6), dict),
    ):
        pytest.fail("it was let in")
    with RunDirectory.prepare(tmp_path, scenario_of(1), dict) as run:
        assert run.is_finished(JOB)


def test_somebody_elses_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("precious")
    with pytest.raises(UserError, match=r"holds files but no run.*--out"):
        filled(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("place", ["file", "file/below", "file/far/below"])
def test_a_place_that_cannot_be_a_folder_is_refused(tmp_path: Path, place: str) -> None:
    (tmp_path / "file").write_text("precious")
    with pytest.raises(UserError, match="--out") as caught:
        filled(tmp_path / place)
    assert "\n" not in str(caught.value)


def test_what_is_no_run_directory_is_not_opened(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "missing"):
        with pytest.raises(UserError, match="is no run directory"):
            RunDirectory.open(path)


def test_two_processes_cannot_write_one_directory(tmp_path: Path) -> None:
    filled(tmp_path, 1)
    other = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)], cwd=ROOT, env=environment(), stdout=subprocess.PIPE
    )
    try:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(UserError, match="another process is writing"):
            filled(tmp_path, 1)
        assert RunDirectory.open(tmp_path).is_finished(JOB)  # reading is free
    finally:
        other.kill()
        other.communicate()
    filled(tmp_path, 1)  # the lock died with its holder


def test_stale_temporary_files_are_swept(tmp_path: Path) -> None:
    filled(tmp_path, 1)
    stale = [tmp_path / ".verdicts.json.abc.tmp", tmp_path / "trials/default/.0.npz.xyz.tmp"]
    for path in stale:
        path.write_bytes(b"half")
    with RunDirectory.prepare(tmp_path, scenario_of(1), dict) as run:
        assert not any(path.exists() for path in stale)
        assert run.is_finished(JOB)


@pytest.mark.parametrize("suffix", [".npz", ".parquet"])
@pytest.mark.parametrize("keep", [0, 1, 100, -1])
def test_a_truncated_file_is_set_aside_and_only_that_trial_is_lost(
    tmp_path: Path, suffix: str, keep: int
) -> None:
    run = filled(tmp_path)
    victim = tmp_path / f"trials/default/1{suffix}"
    victim.write_bytes(victim.read_bytes()[:keep])
    if suffix == ".parquet":
        with pytest.raises(UserError, match="run the scenario again"):
            run.read_rows(Job("default", 1))
    notices: list[str] = []
    assert run.finished(jobs_of(run.scenario), notices.append) == {Job("default", 0), Job("default", 2)}
    assert len(notices) == 1
    assert "\n" not in notices[0]
    assert victim.with_name(victim.name + ".damaged").is_file()
    assert not run.is_finished(Job("default", 1))
    run.write_trial(Job("default", 1), trial_result(1))
    assert len(run.finished(jobs_of(run.scenario), pytest.fail)) == 3


def test_arrays_that_are_gone_or_of_another_trial_are_noticed(tmp_path: Path) -> None:
    run = filled(tmp_path)
    folder = tmp_path / "trials/default"
    (folder / "0.npz").unlink()
    shutil.copy(folder / "2.npz", folder / "1.npz")
    assert run.finished(jobs_of(run.scenario), lambda _: None) == {Job("default", 2)}


def test_an_error_is_kept_until_the_trial_finishes(tmp_path: Path) -> None:
    with RunDirectory.prepare(tmp_path, scenario_of(1), dict) as run:
        file = run.write_error(JOB, "Traceback ...")
        assert file == tmp_path / "trials/default/0.error.txt"
        assert file.read_text() == "Traceback ..."
        assert not run.is_finished(JOB)
        run.write_trial(JOB, trial_result(0))
        assert not file.exists()


def test_a_row_that_was_altered_in_a_sound_table_is_noticed(tmp_path: Path) -> None:
    run = filled(tmp_path, 1)
    file = tmp_path / "trials/default/0.parquet"
    table = pq.read_table(file)
    column = table.schema.get_field_index("verdict")
    flipped = pa.array(
        ["inappropriate" if v.as_py() == "appropriate" else "appropriate" for v in table["verdict"]]
    )
    pq.write_table(table.set_column(column, "verdict", flipped), file)  # the metadata goes along
    with pytest.raises(UserError, match="rows are not those that were written"):
        run.read_rows(JOB)


def test_a_trial_is_never_half_there_after_a_kill(tmp_path: Path) -> None:
    filled(tmp_path, 1)
    seen = 0
    for delay in (0.002, 0.011, 0.023, 0.037, 0.051, 0.1, 0.2, 0.4, 0.8):
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(tmp_path)], cwd=ROOT, env=environment(), stdout=subprocess.PIPE
        )
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"writing\n"
        time.sleep(delay)
        writer.send_signal(signal.SIGKILL)
        writer.communicate()
        with RunDirectory.prepare(tmp_path, scenario_of(500), dict) as run:
            jobs = jobs_of(run.scenario)
            finished = run.finished(jobs, pytest.fail)
        assert all(job in finished for job in jobs if run.is_finished(job))
        assert not list(tmp_path.rglob("*.tmp"))
        assert len(finished) >= seen
        seen = len(finished)
        if delay > 0.05 and seen > 1:
            break
    assert seen > 1  # the kills fell among the writing, however slow it is


@pytest.mark.parametrize("option", ["size=150k", "ro"])
def test_a_full_or_read_only_disk(tmp_path: Path, option: str) -> None:
    """On a real file system of that kind, in a mount namespace of its own."""
    mount = f"mount -t tmpfs -o {option} none '{tmp_path}'"
    if subprocess.run(["unshare", "-m", "sh", "-c", mount], capture_output=True, check=False).returncode:
        pytest.skip("mounting a file system is not permitted here")
    script = f"{mount} && exec '{sys.executable}' -c '{FULL_DISK}' '{tmp_path}' {option}"
    done = subprocess.run(
        ["unshare", "-m", "sh", "-c", script],
        cwd=ROOT,
        env=environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tests'}"}


HOLDER = """
import sys, time
from pathlib import Path
from trial_builder import scenario_of
from testbed.experiment.run_directory import RunDirectory
with RunDirectory.prepare(Path(sys.argv[1]), scenario_of(1), dict):
    print("held", flush=True)
    time.sleep(60)
"""

WRITER = """
import sys
from pathlib import Path
from trial_builder import assert_same, scenario_of, trial_result
from testbed.experiment.jobs import jobs_of
from testbed.experiment.run_directory import RunDirectory
with RunDirectory.prepare(Path(sys.argv[1]), scenario_of(500), dict) as run:
    print("writing", flush=True)
    for job in jobs_of(run.scenario):
        if not run.is_finished(job):
            run.write_trial(job, trial_result(job.trial, size=20_000))
"""

FULL_DISK = """
import subprocess
import sys
from pathlib import Path
import trial_builder
from testbed.errors import UserError
from testbed.experiment.jobs import jobs_of
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.runner import run

path, option = Path(sys.argv[1]) / "run", sys.argv[2]
scenario = trial_builder.scenario_of(20)
computed = []
def compute(job, progress):
    computed.append(job)
    return trial_builder.trial_result(job.trial, size=2000)
try:
    run(scenario, out=path, compute=compute)
except UserError as error:
    message = str(error)
else:
    raise SystemExit("no error")
if option == "ro":
    assert "could not be written (read-only file system)" in message, message
    assert not computed
else:
    assert "the disk is full" in message, message
    assert not list(path.rglob("*.tmp"))
    first = list(computed)
    directory = RunDirectory.open(path)
    finished = directory.finished(jobs_of(scenario), print)
    assert finished == set(first[:-1]), (finished, first)
    assert len(finished) > 2
    subprocess.run(["mount", "-o", "remount,size=10m", sys.argv[1]], check=True)
    run(scenario, out=path, compute=compute)
    assert computed == first + list(jobs_of(scenario))[len(finished):], computed
"""
