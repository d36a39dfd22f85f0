"""The command: its status, one line for a user's mistake, JSON where a program reads it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from trial_builder import compute, scenario_of

import testbed.experiment.runner as runner_module
from testbed import cli
from testbed.experiment.executor import Progress
from testbed.experiment.jobs import Job
from testbed.experiment.record import TrialResult
from testbed.scenario import Scenario

ROOT = Path(__file__).resolve().parents[1]
Said = tuple[int, str, str]


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Any:
    """Runs the command in this process, with invented trials and reports."""

    def instant(scenario: Scenario, job: Job, progress: Progress, *, idle: int) -> TrialResult:
        return compute(job, progress)

    def page(folder: Path) -> Path:
        (folder / "report.html").write_text("<p>report</p>")
        return folder / "report.html"

    monkeypatch.setattr(runner_module, "live", instant)
    monkeypatch.setattr(cli, "_report_of", page)

    def run(*arguments: str) -> Said:
        status = cli._status(cli.app, list(arguments))
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


def test_run_ends_with_the_verdicts_and_the_report(say: Any, tmp_path: Path) -> None:
    status, out, err = say("run", "whom_to_imitate", "--out", str(tmp_path / "r"), "--workers", "1")
    assert (status, err) == (0, "")
    assert "Whom to imitate?" in out
    assert "verdicts are right" in out
    assert out.strip().splitlines()[-1] == f"report: {tmp_path / 'r' / 'report.html'}"
    assert (tmp_path / "r" / "verdicts.json").is_file()


def test_a_student_without_teachers_has_a_report_too(
    say: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def alone(scenario: Scenario, job: Job, progress: Progress, *, idle: int) -> TrialResult:
        result = compute(job, progress)
        names = {"kind": "self", "trial": job.trial, "cell": job.cell, "student": "like_me"}
        return TrialResult(({**names, "topology_right": True},), result.arrays)

    monkeypatch.setattr(runner_module, "live", alone)
    out = str(tmp_path / "r")
    status, told, _ = say("run", "self_discovery", "--trials", "1", "--out", out, "--workers", "1")
    assert (status, told.strip().splitlines()[-1]) == (0, f"report: {tmp_path / 'r' / 'report.html'}")
    assert say("report", out)[0] == 0


def test_run_prints_json_and_nothing_else_for_programs(say: Any, tmp_path: Path) -> None:
    status, out, _ = say("run", "whom_to_imitate", "--out", str(tmp_path), "--json", "--workers", "1")
    contents = json.loads(out)
    assert status == 0
    assert contents["run"] == str(tmp_path)
    written = json.loads((tmp_path / "verdicts.json").read_text())
    assert contents["verdicts"][0]["teacher"] == written["verdicts"][0]["teacher"]


def test_options_of_run_reach_the_scenario(say: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ("run", "whom_to_imitate", "--seed", "77", "--trials", "3", "--workers", "1", "--json")
    _, out, _ = say(*arguments)
    assert json.loads(out)["summary"]["paper"]["trials"] == 3
    assert json.loads(out)["hash"] == json.loads(out)["run"].rpartition("-")[2]
    assert json.loads(say(*arguments, "--smoke")[1])["hash"] != json.loads(out)["hash"]
    assert len(list((tmp_path / "runs").iterdir())) == 2


def test_failed_trials_make_the_status_1(say: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(scenario: Scenario, job: Job, progress: Progress, *, idle: int) -> TrialResult:
        if job.trial == 1:
            raise RuntimeError("servo on fire")
        return compute(job, progress)

    monkeypatch.setattr(runner_module, "live", broken)
    arguments = ("run", "whom_to_imitate", "--trials", "2", "--workers", "1", "--out", str(tmp_path))
    status, out, err = say(*arguments)
    assert status == 1
    assert "trial 1 failed: RuntimeError: servo on fire" in " ".join(out.split())
    assert err == "testbed: 1 of 2 trials failed (trial 1); run it again to retry them\n"


def test_a_users_mistake_that_a_trial_meets_is_one_line_and_status_2(
    say: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def mistaken(scenario: Scenario, job: Job, progress: Progress, *, idle: int) -> TrialResult:
        if job.trial == 1:
            raise scenario.source.error(("world",), "the episode is too short", "raise world.max_cycles")
        return compute(job, progress)

    monkeypatch.setattr(runner_module, "live", mistaken)
    arguments = ("run", "whom_to_imitate", "--trials", "3", "--workers", "1", "--out", str(tmp_path))
    status, _, err = say(*arguments)
    assert status == 2
    assert err.count("\n") == 1
    assert err.endswith("the episode is too short; raise world.max_cycles\n")
    assert not list(tmp_path.rglob("*error.txt"))
    assert [path.name for path in tmp_path.glob("trials/default/*.parquet")] == ["0.parquet"]


@pytest.mark.parametrize(
    ("arguments", "fragments"),
    [
        (("run", "whom_to_imitat"), ("unknown scenario", "whom_to_imitate")),
        (("run", "missing.yaml"), ("missing.yaml",)),
        (("run", "whom_to_imitate", "--trials", "0"), ("at least 1",)),
        (("run", "whom_to_imitate", "--trials", "many"), ("--trials", "integer")),
        (("run", "whom_to_imitate", "--seed", "-1"), ("seed",)),
        (("run", "whom_to_imitate", "--workers", "0"), ("workers",)),
        (("run", "whom_to_imitate", "--out", "/dev/null"), ("--out",)),
        (("run", "whom_to_imitate", "--out", "/dev/null/below"), ("--out",)),
        (("run", "whom_to_imitate", "--ot", "x"), ("--ot",)),
        (("run",), ("FILE",)),
        (("rum", "x"), ("rum",)),
        (("check", "missing.yaml"), ("missing.yaml",)),
        (("show", "crawlr"), ("unknown robot", "crawler")),
        (("show", "crawler", "--out", "picture.exe"), (".png",)),
        (("report", "."), ("no run directory",)),
    ],
)
def test_a_mistake_is_one_line_and_status_2(
    say: Any, arguments: tuple[str, ...], fragments: tuple[str, ...]
) -> None:
    status, out, err = say(*arguments)
    assert status == 2
    assert out == ""
    assert err.startswith("testbed: ")
    assert err.count("\n") == 1
    for fragment in fragments:
        assert fragment in err


def test_a_bad_scenario_is_told_with_file_and_line(say: Any, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("seed: 1\ntrails: 3\nteachers:\n  - {robot: crawler, gait: crawl}\n")
    for command in ("check", "run"):
        status, _, err = say(command, str(file))
        assert status == 2
        assert "mine.yaml:2" in err
        assert "trials" in err


def test_check_says_that_all_is_well(say: Any) -> None:
    status, out, _ = say("check", "paper")
    assert status == 0
    assert out.startswith("paper is fine: 2 teachers, 30 trials, hash ")
    assert json.loads(say("check", "paper", "--json")[1])["trials"] == 30


def test_list_names_what_can_be_named(say: Any) -> None:
    names = json.loads(say("list", "--json")[1])
    assert {"crawler", "splayed"} <= set(names["robots"])
    assert {"paper", "whom_to_imitate"} <= set(names["scenarios"])
    assert "paper" in names["students"]
    assert "crawl" in names["gaits"]
    plain = say("list")[1]
    assert all(name in plain for known in names.values() for name in known)


def test_show_draws_the_robot_and_tells_its_parts(say: Any, tmp_path: Path) -> None:
    picture = tmp_path / "crawler.png"
    status, out, err = say("show", "crawler", "--out", str(picture))
    assert status == 0, err
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "crawler: 3 parts, " in out
    assert "14 x 11 x 5 cm" in out
    assert "-90 to 90 deg" in out
    facts = json.loads(say("show", "crawler", "--out", str(picture), "--json")[1])
    assert facts["mass"] == pytest.approx(sum(part["mass"] for part in facts["parts"].values()))


def test_report_is_written_again(say: Any, tmp_path: Path) -> None:
    runner_module.run(scenario_of(2), out=tmp_path, compute=compute)
    before = (tmp_path / "verdicts.json").read_bytes()
    (tmp_path / "verdicts.json").unlink()
    status, out, _ = say("report", str(tmp_path))
    assert (status, out) == (0, f"report: {tmp_path / 'report.html'}\n")
    assert (tmp_path / "verdicts.json").read_bytes() == before


def test_an_internal_error_keeps_its_traceback_in_the_run_directory(
    say: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(folder: Path) -> Path:
        raise KeyError("surprise")

    monkeypatch.setattr(cli, "_report_of", broken)
    status, _, err = say("run", "whom_to_imitate", "--workers", "1", "--out", str(tmp_path))
    assert status == 1
    assert err.count("\n") == 1
    assert "internal error (KeyError: 'surprise')" in err
    assert str(tmp_path / "error.txt") in err
    assert "in broken" in (tmp_path / "error.txt").read_text()


@pytest.mark.parametrize("through_compiled_code", [False, True])
def test_ctrl_c_is_status_130_and_one_line(
    say: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, through_compiled_code: bool
) -> None:
    def stopped(scenario: Scenario, job: Job, progress: Progress, *, idle: int) -> TrialResult:
        if through_compiled_code:
            raise SystemError("returned a result with an exception set") from KeyboardInterrupt()
        raise KeyboardInterrupt

    monkeypatch.setattr(runner_module, "live", stopped)
    status, _, err = say("run", "whom_to_imitate", "--workers", "1", "--out", str(tmp_path))
    assert status == 130
    assert err.count("\n") == 1
    assert f"continue with: testbed run whom_to_imitate --workers 1 --out {tmp_path}" in err


def test_a_reader_that_goes_away_is_no_traceback() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        command = [sys.executable, "-m", "testbed", "list", "--json"]
        done = subprocess.run(
            command, cwd=ROOT, stdout=writer, stderr=subprocess.PIPE, text=True, check=False
        )
    finally:
        os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


def test_every_command_has_help_with_an_example(say: Any) -> None:
    commands = {command.name or command.callback.__name__ for command in cli.app.registered_commands}
    assert {"run", "check", "list", "show", "report", "query", "export"} <= commands
    for command in commands:
        status, out, _ = say(command, "--help")
        assert status == 0
        assert f"Example: testbed {command}" in " ".join(out.split())


@pytest.mark.parametrize("arguments", [["--help"], ["list"]])
def test_light_commands_answer_at_once(arguments: list[str]) -> None:
    elapsed = []
    for _ in range(3):
        began = time.perf_counter()
        subprocess.run(
            [sys.executable, "-m", "testbed", *arguments],
            cwd=ROOT,
            env=os.environ,
            capture_output=True,
            check=True,
        )
        elapsed.append(time.perf_counter() - began)
    program = f"import sys; from testbed import cli; cli._status(cli.app, {arguments}); print('MODULES', *sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    modules = loaded.stdout.partition("MODULES ")[2].split()
    assert "testbed.cli" in modules
    assert not {"numba", "pybullet", "pyarrow", "matplotlib", "scipy", "cv2", "pettingzoo"} & set(modules)
    assert min(elapsed) < 1.5  # 0.3 s on an idle machine


def test_splits_and_executors_are_chosen_by_name_and_a_sweep_tells_its_cells(
    say: Any, tmp_path: Path
) -> None:
    file = tmp_path / "x.yaml"
    file.write_text(
        "seed: 1\nstudent: like_me\nteachers: [{robot: crawler, gait: {kind: still}}]\n"
        "sweep: {over: {rig.camera_noise: [2, 4, 6]}}\nsplits: {held_out: {seed: 9}}\n"
    )
    status, out, _ = say("check", str(file))
    assert (status, out.startswith("x is fine: 1 teacher, 3 cells, 3 trials, hash ")) == (0, True)
    for arguments, complaint in (
        (("--split", "heldout"), "there is no split 'heldout'; did you mean 'held_out'?"),
        (("--seed", "9"), "seed 9 is that of the split 'held_out'"),
        (("--executor", "rai"), "there is no executor 'rai'; did you mean 'ray'?"),
        (("--address", "here:1"), "processes are on this machine and have no address"),
    ):
        status, _, err = say("run", str(file), "--out", str(tmp_path / "run"), *arguments)
        assert status == 2
        assert complaint in err
        assert len(err.strip().splitlines()) == 1
