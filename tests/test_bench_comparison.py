"""A run on the bench against the same run in simulation: known differences come out as what they are, with N."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from testbed import cli
from testbed.experiment.backends import bench_path, sim_and_bench
from testbed.experiment.bench_measures import Measure, agreed, measures
from testbed.experiment.bench_twin import Twin, rests, twin_of
from testbed.experiment.executor import Progress
from testbed.experiment.jobs import Job
from testbed.experiment.record import Row, TrialResult
from testbed.experiment.run_directory import RunDirectory
from testbed.experiment.runner import OnBench, run
from testbed.experiment.sim_and_bench import Comparison, compared
from testbed.report.bench_comparison import headline, write_bench_comparison
from testbed.scenario import Scenario, load_scenario, with_overrides

Arrays = dict[str, NDArray[Any]]
COMMANDS = np.radians([[50.0, -30.0], [-20.0, 60.0], [0.0, 80.0], [40.0, 40.0], [70.0, 0.0]])
HELD = 30  # control steps
PERFORMED = 60


@dataclass(frozen=True)
class World:
    """What is different from the simulation."""

    tilted: tuple[float, float] = (0.0, 0.0)  # rad more to the side, and nose-down
    lag: float = 0.0  # s
    rolled: float = 0.0  # rad: how much more the last part swings
    farther: float = 1.0
    truth: bool = True
    seen: int = 0  # in which order the student saw the parts
    wrong: tuple[int, ...] = ()  # trials in which the second verdict is another one
    parts: Mapping[str, int] = field(default_factory=lambda: {"teacher_0": 3, "teacher_1": 3})


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return with_overrides(load_scenario("bench"), trials=3)


@functools.cache
def _twin(seed: int, trial: int, actions: bytes) -> Twin:
    scenario = with_overrides(load_scenario("bench"), seed=seed)
    return twin_of(scenario, Job("default", trial), np.frombuffer(actions).reshape(-1, 3))


def lived(scenario: Scenario, job: Job, world: World) -> TrialResult:
    """A life of five commands and a performance; places and tilts are those of the simulated body."""
    rng = np.random.default_rng([job.trial, world.seen])
    joints = np.concatenate([np.repeat(COMMANDS, HELD, axis=0), np.zeros((PERFORMED, 2))])
    swing = np.sin(np.arange(PERFORMED) / 6)[:, None] * [0.6, -0.4] + [0.0, 0.6]
    joints[-PERFORMED:] = swing * (1 + 0.1 * job.trial)
    actions = np.column_stack([joints, np.zeros(len(joints))])
    twin = _twin(scenario.seed, job.trial, actions.tobytes())
    base = twin.base.copy()
    start = len(COMMANDS) * HELD + 1
    base[start:, :2] = base[start - 1, :2] + world.farther * (base[start:, :2] - base[start - 1, :2])
    tilt = twin.tilt[[HELD * (number + 1) for number in range(len(COMMANDS))]] + world.tilted
    arrays: Arrays = {
        "time/control_step": np.array(scenario.world.control_step),
        "truth/student/actions": actions,
        "self/commands": COMMANDS,
        "self/tilt": tilt,
        "perform/start_step": np.array(start),
        "perform/steps": np.array(PERFORMED),
    }
    if world.truth:
        arrays |= {"truth/student/base": base, "truth/student/joints": np.zeros((len(base), 2))}
    rows: list[Row] = []
    times = np.arange(60) / 15
    for number, (teacher, count) in enumerate(world.parts.items()):
        waves = np.sin((times[:, None] - world.lag) * math.pi + np.arange(count) + job.trial) * 0.6
        waves[:, -1] *= 1 + world.rolled / 0.6
        parts = np.zeros((60, count, 8))
        order = rng.permutation(count)
        parts[:, order, 4] = waves
        arrays |= {
            f"{teacher}/motion_times": times + 3.0,
            f"{teacher}/motion_parts": parts,
            f"{teacher}/order": order,
            f"{teacher}/images": np.full((2, 2, 75, 100), 200, np.uint8),
        }
        truth = "inappropriate" if number else "appropriate"
        said = "appropriate" if number and job.trial in world.wrong else truth
        rows.append(
            {"kind": "verdict", "trial": job.trial, "cell": job.cell, "student": "like_me", "teacher": teacher,
             "robot": "crawler", "truth": truth, "verdict": said, "score": 1.0 - number, "score_low": None,
             "score_high": None, "found": True, "chosen": not number, "probability": 0.9 - 0.8 * number}
        )  # fmt: skip
    return TrialResult(tuple(rows), arrays)


def ran(folder: Path, scenario: Scenario, world: World, *, on_bench: bool) -> RunDirectory:
    def compute(job: Job, progress: Progress) -> TrialResult:
        return lived(scenario, job, world)

    run(scenario, out=folder, compute=compute)
    if on_bench:
        file = folder / "provenance.json"
        file.write_text(json.dumps({**json.loads(file.read_text()), "backend": "hardware"}))
    return RunDirectory.open(folder)


@pytest.fixture(scope="module")
def simulation(tmp_path_factory: pytest.TempPathFactory, scenario: Scenario) -> RunDirectory:
    return ran(tmp_path_factory.mktemp("simulation"), scenario, World(), on_bench=False)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory, scenario: Scenario) -> RunDirectory:
    """As in simulation."""
    return ran(tmp_path_factory.mktemp("bench"), scenario, World(), on_bench=True)


def against(simulation: RunDirectory, folder: Path, scenario: Scenario, world: World) -> Comparison:
    return compared(simulation, ran(folder, scenario, world, on_bench=True))


def of(told: Comparison, start: str) -> Measure:
    (found,) = [each for each in measures(told) if each.name.startswith(start)]
    return found


def test_a_bench_that_is_the_simulation_differs_by_nothing(
    simulation: RunDirectory, scenario: Scenario, tmp_path: Path
) -> None:
    told = against(simulation, tmp_path, scenario, World(seen=1))
    for each in measures(told):
        assert each.gap == pytest.approx(0.0 if each.unit else 1.0, abs=1e-9), each.name
    assert {round(each.lag, 9) for each in told.rolls} == {0.0}
    assert agreed(told) == (6, 6)
    assert "6 of 6" in headline(told)


def test_a_difference_in_tilt_comes_out_with_its_sign_and_n(
    simulation: RunDirectory, scenario: Scenario, tmp_path: Path
) -> None:
    told = against(simulation, tmp_path, scenario, World(tilted=(math.radians(-0.5), math.radians(2))))
    nose, side = of(told, "tilt after a command, nose-down"), of(told, "tilt after a command, to the side")
    assert (nose.gap, side.gap) == (pytest.approx(2.0), pytest.approx(-0.5))
    assert (nose.n, nose.trials, nose.over) == (15, 3, "trials")
    assert nose.bench is not None
    assert nose.simulation is not None
    assert nose.bench - nose.simulation == pytest.approx(2.0)
    assert nose.interval is not None
    assert nose.interval.low <= 2.0 + 1e-9 <= nose.interval.high + 2e-9
    assert of(told, "size of the difference in tilt").gap == pytest.approx(math.hypot(2, 0.5))
    assert "2.1°" in headline(told)


def test_rolls_are_compared_after_the_lag_part_by_part(
    simulation: RunDirectory, scenario: Scenario, tmp_path: Path
) -> None:
    told = against(simulation, tmp_path, scenario, World(lag=0.1, rolled=0.1))
    assert len(told.rolls) == 6
    for each in told.rolls:
        assert each.lag == pytest.approx(0.1, abs=0.02)
        rms = np.degrees(np.sqrt(np.mean(each.gaps**2, axis=0)))
        assert rms[:2].max() < 1.0
        assert rms[2] == pytest.approx(np.degrees(0.1 / math.sqrt(2)), abs=1.0)
    like = of(told, "rolls of teachers like")
    assert (like.n, like.trials) == (9, 3)


def test_verdicts_that_differ_are_counted(
    simulation: RunDirectory, scenario: Scenario, tmp_path: Path
) -> None:
    told = against(simulation, tmp_path / "bench", scenario, World(wrong=(1,)))
    measure = of(told, "verdicts of like_me")
    assert (measure.gap, measure.n) == (pytest.approx(5 / 6), 6)
    assert (measure.simulation, measure.bench) == (1.0, pytest.approx(5 / 6))
    assert measure.interval is not None
    assert 0.4 < measure.interval.low < 5 / 6 < measure.interval.high < 1
    assert headline(told).startswith("Bench and simulation agree in 5 of 6 verdicts")


def test_paths_are_compared_with_the_twin_that_had_the_same_commands(
    simulation: RunDirectory, scenario: Scenario, tmp_path: Path
) -> None:
    told = against(simulation, tmp_path, scenario, World(farther=1.5))
    performed, twin = of(told, "distance performed"), of(told, "distance under the bench's own")
    assert performed.simulation is not None
    assert performed.simulation > 0.5  # cm: the body did move
    assert performed.gap == pytest.approx(0.5 * performed.simulation)
    assert twin.gap == pytest.approx(performed.gap)  # the twin of these trials is the simulation itself
    np.testing.assert_allclose(told.paths[0].twin, told.paths[0].simulation, atol=1e-9)


def test_a_bench_without_truth_has_no_paths_and_says_so(
    simulation: RunDirectory, scenario: Scenario, tmp_path: Path
) -> None:
    told = against(simulation, tmp_path / "bench", scenario, World(truth=False))
    assert told.placeless
    assert not told.paths
    assert of(told, "size of the difference in tilt").n == 15
    page = write_bench_comparison(told, tmp_path / "page").read_text()
    assert "Nobody measured where things are on this bench" in page
    assert "nan" not in page.lower().replace("nano", "")


def test_other_parts_are_not_compared(simulation: RunDirectory, scenario: Scenario, tmp_path: Path) -> None:
    told = against(simulation, tmp_path, scenario, World(parts={"teacher_0": 3, "teacher_1": 2}))
    assert {each.teacher for each in told.rolls} == {"teacher_0"}


def test_the_same_runs_give_the_same_files(
    simulation: RunDirectory, scenario: Scenario, tmp_path: Path
) -> None:
    world = World(lag=0.05, tilted=(0.01, 0.02), wrong=(1,))
    told = against(simulation, tmp_path / "bench", scenario, world)
    for name in ("one", "two"):
        write_bench_comparison(told, tmp_path / name)
    for file in (
        "report.html",
        "comparison.json",
        "figures/tilt.svg",
        "figures/rolls.svg",
        "figures/paths.svg",
    ):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()
    page = (tmp_path / "one/report.html").read_text()
    assert "agree in 5 of 6 verdicts" in page
    assert page.count("90% sure") == 11
    numbers = json.loads((tmp_path / "one/comparison.json").read_text())
    assert len(numbers["verdicts"]) == 6
    assert {"name", "n", "gap", "interval", "trials"} <= numbers["measures"][0].keys()


def test_only_one_scenario_in_both_worlds_is_compared_so(
    simulation: RunDirectory, bench: RunDirectory, scenario: Scenario, tmp_path: Path
) -> None:
    found = sim_and_bench([bench.path, simulation.path])
    assert found is not None
    assert [each.path for each in found] == [simulation.path, bench.path]
    assert sim_and_bench([simulation.path, simulation.path]) is None
    assert sim_and_bench([simulation.path]) is None
    other = with_overrides(scenario, seed=99)
    assert (
        sim_and_bench([simulation.path, ran(tmp_path / "other", other, World(), on_bench=True).path]) is None
    )


def test_the_command_finds_the_right_page(
    simulation: RunDirectory,
    bench: RunDirectory,
    scenario: Scenario,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = ["report", str(simulation.path), str(bench.path), "--out", str(tmp_path / "page")]
    assert cli._status(cli.app, [*arguments, "--json"]) == 0
    contents = json.loads(capsys.readouterr().out)
    assert contents["report"] == str(tmp_path / "page" / "report.html")
    assert contents["hash"] == bench.hash8
    (tmp_path / "page" / "comparison.json").unlink()
    assert cli._status(cli.app, arguments) == 2
    assert "holds something else" in capsys.readouterr().err


def test_runs_of_both_worlds_never_mix_in_a_folder(
    simulation: RunDirectory,
    bench: RunDirectory,
    scenario: Scenario,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def never(*_: object) -> Any:
        raise AssertionError("a stage was opened")

    with pytest.raises(Exception, match="holds a run in simulation; give another folder"):
        run(scenario, out=simulation.path, bench=OnBench(never))
    with pytest.raises(Exception, match="holds a run on a bench; give another folder"):
        run(scenario, out=bench.path)
    assert bench_path(scenario).name == f"bench-{bench.hash8}-bench"


@settings(max_examples=50, deadline=None)
@given(
    angles=st.lists(st.tuples(st.integers(-80, 80), st.integers(-80, 80)), min_size=1, max_size=8),
    held=st.integers(1, 6),
)
def test_rests_are_where_the_commands_had_been_held(angles: list[tuple[int, int]], held: int) -> None:
    commands = np.radians(np.array(angles, dtype=float))
    flat = np.zeros((held, 2))
    steps = [part for command in commands for part in (flat, np.tile(command, (held, 1)))]
    actions = np.column_stack([np.concatenate(steps), np.zeros(2 * held * len(commands))])
    found = rests(commands, actions)
    for number, (command, step) in enumerate(zip(commands, found, strict=True)):
        if np.any(command):
            assert step == 2 * held * (number + 1) or any(not np.any(c) for c in commands[:number])
        assert step is None or np.array_equal(actions[step - 1, :2], command)
    assert rests(commands + 10, actions) == [None] * len(commands)
