"""Whole trials: one student beside the other, what a second core brings, and the command that users try first."""

from __future__ import annotations

import itertools
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.measure import Seconds, Settings, command, interleaved, pinned
from benchmarks.row import Row, faster, within
from testbed.experiment.runner import run
from testbed.experiment.trial import run_trial
from testbed.scenario import Scenario, load_scenario, with_overrides

SEED = 7  # a development seed: the shipped scenarios' own are for what is reported
LIKE_ME_SECONDS = 5.0
TRIALS, MINUTES, SPEED_UP = 30, 3.0, 1.7
OF_THIRTY = 4
FLOOR = (
    "two controllers of 500 mutations take some 800,000 steps of PyBullet a trial, at 21 us each 17 s of a core, "
    "when none is imagined further than it can win; a coarser imagined step would be another student"
)
SLOW_ROUNDS = 3  # of what takes half a minute and more
MAKE_RUN_SECONDS = 30.0
BEFORE = np.array([66.2, 63.5])
"""Processor seconds of `testbed run whom_to_imitate`, compiled, at commit b42871f on a machine as described there."""
BEFORE_NOTE = (
    "processor seconds; before: 65 at commit b42871f, on two cores of an AMD EPYC (Zen 5), not in this run"
)


def rows(settings: Settings) -> Iterator[Row]:
    """One trial, thirty, and `make run`."""
    yield from one_trial(settings)
    with pinned(pin=False):
        yield from thirty(settings)
        yield from make_run(settings)


def one_trial(settings: Settings) -> Iterator[Row]:
    """The same teacher, the same world; another trial in each round."""
    calls = {
        "like_me": living("like_me"),
        "paper": living("paper"),
        "and imitates": living("like_me", imitates=True),
    }
    for call in calls.values():
        call()  # compiles, or loads what was compiled
    seconds = interleaved(calls, min(settings.rounds, 7), once=True)
    name = "a whole trial of like_me: self-discovery, one teacher, verdict"
    world = "processor time, the world with its pictures included"
    yield within(name, LIKE_ME_SECONDS, seconds["like_me"], note=world)
    yield faster(name, "the student `paper`", seconds["paper"], seconds["like_me"])
    more = "and then it practises and imitates"
    yield faster(f"{name}, {more}", "without", seconds["like_me"], seconds["and imitates"])


def living(student: str, *, imitates: bool = False) -> Callable[[], object]:
    """One trial after the other with one teacher, up to the verdict or to the end."""
    of = load_scenario("whom_to_imitate" if student == "like_me" else "paper")
    scenario = with_overrides(of, seed=SEED).model_copy(update={"beside": (), "teachers": of.teachers[:1]})
    if not imitates:
        parameters = scenario.student.parameters
        step = scenario.world.control_step
        brief = parameters.performing.model_copy(update={"practice": 0, "seconds": step, "ramp": step})
        spec = scenario.student.model_copy(
            update={"parameters": parameters.model_copy(update={"performing": brief})}
        )
        scenario = scenario.model_copy(update={"student": spec})
    numbers = itertools.count()
    return lambda: run_trial(scenario, next(numbers))


def thirty(settings: Settings) -> Iterator[Row]:
    """`paper.yaml` with one worker and with two, from start-up to verdicts.json; by the clock."""
    trials = TRIALS if settings.full else OF_THIRTY
    scenario = with_overrides(load_scenario("paper"), seed=SEED, trials=trials)
    calls = {"one": running(scenario, 1), "two": running(scenario, 2)}
    times = interleaved(calls, min(settings.rounds, SLOW_ROUNDS), once=True, clock=time.perf_counter)
    of = "" if settings.full else f"; {trials} of them measured, start-up included"
    note = f"seed {SEED}, by the clock{of}"
    why = "what two plain processes bring on this machine stands beside the row of the sweep"
    name = "paper.yaml, 30 trials, two cores"
    yield faster(name, "one core", times["one"], times["two"], SPEED_UP, note=note, why=why)
    whole: Seconds = times["two"] * (TRIALS / trials)
    yield within(name, MINUTES * 60, whole, note=note, why=FLOOR)


def running(scenario: Scenario, workers: int) -> Callable[[], object]:
    """The scenario in a run directory of its own."""

    def call() -> None:
        with tempfile.TemporaryDirectory() as folder:
            outcome = run(scenario, out=Path(folder) / "run", workers=workers)
            assert not outcome.failed

    return call


def make_run(settings: Settings) -> Iterator[Row]:
    """What `make run` does once everything is installed and compiled, report and video included; by the clock."""
    run_once()
    walls, processors = np.array([run_once() for _ in range(min(settings.rounds, SLOW_ROUNDS))]).T
    name = "`make run`, installed and compiled"
    busy = f"{np.median(processors):.0f} processor seconds"
    why = "half of it is the paper's student beside, on the second core meanwhile; a quarter is the report"
    yield within(name, MAKE_RUN_SECONDS, walls, note=f"by the clock, all cores; {busy}", why=why)
    before = np.resize(BEFORE, len(processors))
    yield faster(name, "commit b42871f", before, processors, note=BEFORE_NOTE)


def run_once() -> tuple[float, float]:
    """Seconds by the clock, and of processors."""
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "run")
        return command([sys.executable, "-m", "testbed", "run", "whom_to_imitate", "--out", out])
