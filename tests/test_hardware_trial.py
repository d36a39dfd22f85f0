"""A whole trial on the emulated bench, through a brown-out, and told again; no truth gets to the student."""

from __future__ import annotations

import ast
import shutil
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from bench_builder import SEED, calibrated, short_life
from simavr_needed import simavr_or_skip

import testbed.hardware
from testbed.errors import UserError
from testbed.experiment.backends import HARDWARE
from testbed.experiment.diary import Told
from testbed.experiment.jobs import DEFAULT_CELL, Job
from testbed.experiment.record import Row, TrialResult
from testbed.experiment.relive import relive
from testbed.experiment.replay import Replayed, journal_below, journal_of, replay
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.runner import OnBench, run
from testbed.experiment.stage import Stage
from testbed.hardware.failures import BoardRestarted
from testbed.hardware.journal import Journal, Step, Wire, read_journal, steps_of
from testbed.report.page import write_report
from testbed.scenario import Scenario, drawn, load_scenario
from testbed.world.placement import STUDENT

simavr_or_skip()  # type: ignore[no-untyped-call]

from testbed.hardware.emulation.bench import EmulatedBench  # noqa: E402
from testbed.hardware.operating.stage import BenchStage, on_emulated_bench, workbench_of  # noqa: E402

JOB = Job(DEFAULT_CELL, 0)


@dataclass(frozen=True)
class Lived:
    """A run on the emulated bench.

    Attributes:
        run: What came of it.
        took: How long it took this machine, s of its processor.
        broken: What its journal held when a teacher's supply had sagged in the middle.
    """

    run: RunDirectory
    took: float
    broken: Told

    @property
    def rows(self) -> tuple[Row, ...]:
        return self.run.read_rows(JOB)

    @property
    def journal(self) -> Path:
        return journal_of(self.run, JOB)


@pytest.fixture(scope="module")
def calibrations(tmp_path_factory: pytest.TempPathFactory) -> Path:
    here = drawn(load_scenario("bench"), 0)
    with EmulatedBench(here, seed=SEED) as bench:
        return calibrated(bench, tmp_path_factory.mktemp("calibrations"))


@pytest.fixture(scope="module")
def lived(calibrations: Path, tmp_path_factory: pytest.TempPathFactory) -> Lived:
    """A trial that breaks off while the first teacher is watched, and goes on with the same command."""
    out = tmp_path_factory.mktemp("run") / "bench"
    opened = on_emulated_bench(calibrations, seed=SEED)

    def sagging(scenario: Scenario, journal: Journal | None) -> Stage:
        stage = opened(scenario, journal)
        assert isinstance(stage.truth, EmulatedBench)
        stage.truth.later(10.3, stage.truth.boards["teacher_0"].chip.brown_out)
        return stage

    begun = time.process_time()
    with pytest.raises(BoardRestarted, match="the board of teacher_0 has restarted: a brown-out"):
        run(short_life(), out=out, bench=OnBench(sagging))
    broken = Told(journal_below(out, JOB))
    run(short_life(), out=out, bench=OnBench(opened))
    return Lived(RunDirectory.open(out), time.process_time() - begun, broken)


@pytest.fixture(scope="module")
def again(lived: Lived) -> Replayed:
    return replay(lived.run, JOB)


def verdicts(rows: tuple[Row, ...]) -> list[object]:
    return [(row["teacher"], row["verdict"], row["score"]) for row in rows if row["kind"] == "verdict"]


def test_who_is_like_me_is_told_right_on_the_bench(lived: Lived) -> None:
    rows = [row for row in lived.rows if row["kind"] == "verdict"]
    assert [(row["robot"], row["verdict"]) for row in rows] == [
        ("crawler", "appropriate"),
        ("splayed", "inappropriate"),
    ]
    (itself,) = (row for row in lived.rows if row["kind"] == "self")
    assert itself["topology_right"]
    assert [row["chosen"] for row in rows] == [True, False]
    assert lived.run.provenance["backend"] == HARDWARE


def test_it_went_on_where_it_had_broken_off(lived: Lived) -> None:
    assert lived.broken.steps[-1].commands["teacher_0"].any()
    told = Told(lived.journal)
    assert [note.kind for note in told.notes] == ["unfinished", "failed", "resumed", "finished"]
    (resumed,) = told.resumed
    assert 100 < resumed < len(lived.broken.steps)
    for before, after in zip(lived.broken.steps[: resumed + 1], told.steps, strict=False):
        assert before.tilts[STUDENT].tobytes() == after.tilts[STUDENT].tobytes()


def test_the_report_has_the_truth_that_only_the_bench_knows(lived: Lived) -> None:
    """Of what was lived before it broke off, too."""
    chosen = next(row for row in lived.rows if row.get("chosen"))
    assert chosen["motion_roll_error_median_deg"] < 3.0  # type: ignore[operator]
    assert chosen["path_length"] is not None


def test_the_bench_is_faster_than_its_own_time(lived: Lived) -> None:
    """With all that the student thinks in between."""
    told = Told(lived.journal)
    assert lived.took < sum(note.at for note in told.notes if note.kind in ("failed", "finished"))


def test_everything_is_in_the_journal(lived: Lived) -> None:
    records = read_journal(lived.journal)
    steps = steps_of(records)
    assert [step.number for step in steps] == list(range(len(steps)))
    assert {record.board for record in records if isinstance(record, Wire)} == {
        "student",
        "teacher_0",
        "teacher_1",
        "rig",
    }
    shown = [step for step in steps if step.images is not None]
    assert len(shown) == pytest.approx(len(steps) / 4, rel=0.05)  # where nobody is in view all is white
    (resumed,) = Told(lived.journal).resumed  # on another bench, with a clock of its own
    passed = np.delete(np.diff([step.at for step in steps]), resumed)
    assert passed == pytest.approx(np.full(len(passed), 1 / 30), abs=0.02)


# The student without its robot.


def test_a_student_that_meets_the_same_again_thinks_the_same(lived: Lived, again: Replayed) -> None:
    """No bench is there, and no truth: what the student does depends on what it senses alone."""
    assert again.life is not None
    assert verdicts(again.rows) == verdicts(lived.rows)
    assert again.steps == len(steps_of(read_journal(lived.journal)))


def test_what_only_the_truth_tells_is_missing_without_it(again: Replayed) -> None:
    for row in again.rows:
        if row["kind"] == "verdict":
            assert row["motion_roll_error_median_deg"] is None
            assert row["path_length"] is None


def test_a_run_without_truth_has_its_report(lived: Lived, again: Replayed, tmp_path: Path) -> None:
    """As on a real bench, where nobody knows it."""
    folder = tmp_path / "untold"
    shutil.copytree(lived.run.path, folder)
    assert not any(name.startswith("truth/") and name.endswith("/base") for name in again.arrays)
    with RunDirectory.prepare(folder, short_life(), dict) as directory:
        directory.write_trial(JOB, TrialResult(again.rows, again.arrays))
    assert "appropriate" in write_report(folder).read_text()


def test_a_student_that_does_something_else_is_noticed(lived: Lived, tmp_path: Path) -> None:
    folder = tmp_path / "changed"
    shutil.copytree(lived.run.path, folder)
    (folder / "trials" / "default" / "0.journal").unlink()
    with Journal(folder / "trials" / "default" / "0.journal") as journal:
        for step in steps_of(read_journal(lived.journal)):
            if step.number == 40:
                commands = {**step.commands, STUDENT: np.nextafter(step.commands[STUDENT], 9.0)}
                step = Step(**{**vars(step), "commands": commands})
            journal.step(step)
    with pytest.raises(UserError, match=r"student does not do at step 40 what it did"):
        replay(RunDirectory.open(folder), JOB)


def test_a_journal_that_ends_in_the_middle_is_told_as_far_as_it_goes(lived: Lived, tmp_path: Path) -> None:
    folder = tmp_path / "half"
    shutil.copytree(lived.run.path, folder)
    file = folder / "trials" / "default" / "0.journal"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 3])
    half = replay(RunDirectory.open(folder), JOB)
    assert half.life is None
    assert half.rows == ()
    assert 20 < half.steps < 400


def test_what_was_lived_on_a_bench_is_not_lived_again_in_simulation(lived: Lived) -> None:
    with pytest.raises(UserError, match="testbed replay"):
        relive(lived.run, JOB)


# No truth reaches the student.


def test_the_backend_asks_nobody_for_the_truth(calibrations: Path, tmp_path: Path) -> None:
    """A bench whose truth nobody may ask for works as well."""
    here = drawn(load_scenario("bench"), 0)

    class Secretive(EmulatedBench):
        forbidden = False

        @property
        def pan(self) -> float:
            self._guard()
            return super().pan

        def state(self, robot: str) -> tuple[np.ndarray, np.ndarray]:
            self._guard()
            return super().state(robot)

        def _guard(self) -> None:
            if self.forbidden:
                raise AssertionError("somebody asked for the truth")

    with Secretive(here, seed=SEED, ports=tmp_path) as bench:
        stage = BenchStage(here, workbench_of(bench, tmp_path, calibrations))
        bench.forbidden = True
        stage.backend.reset(np.random.SeedSequence(0))
        stage.backend.apply({STUDENT: np.array([-0.3, 0.2])}, 0.1)
        stage.backend.look()
        stage.close()
        with pytest.raises(AssertionError):
            bench.state(STUDENT)


def test_nothing_but_the_way_in_knows_of_emulation() -> None:
    """Of the hardware modules only those that open an emulated bench import it, and they only when they do."""
    folder = Path(testbed.hardware.__file__).parent
    for file in set(folder.rglob("*.py")) - set((folder / "emulation").iterdir()):
        tree = ast.parse(file.read_text())
        guarded = [node for node in tree.body if isinstance(node, ast.If)]  # TYPE_CHECKING
        for node in tree.body:
            if node in guarded or not isinstance(node, ast.ImportFrom):
                continue
            assert not str(node.module).startswith("testbed.hardware.emulation"), file.name
    for place in (
        folder / "line",
        folder / "robots",
        folder / "rig",
        folder / "calibration",
        folder / "doctor",
    ):
        for file in [*place.glob("*.py"), folder / "backend.py"]:
            assert "testbed.hardware.emulation" not in file.read_text(), file.name
