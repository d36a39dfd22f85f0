"""The guard against getting slower: counts and ratios, never seconds. And the benchmarks' own bookkeeping.

A count that rises is more work for the same answer. If that is meant, measure (`make bench`) and raise the number here;
if it falls, lower it.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pybullet
import pytest

from benchmarks import __main__ as command
from benchmarks import groups, living, modelling, results, seeing, table
from benchmarks.eyes import MissingError, mujoco_eyes, numpy_rays
from benchmarks.measure import Settings, exponent, interleaved, ratio
from benchmarks.row import Row, faster, left_out, measured, within
from benchmarks.scenes import RIG, models, pixels, rays
from testbed.bodies.morphology import load_robot
from testbed.experiment.trial import run_trial
from testbed.scenario import load_scenario, parse_scenario, with_overrides
from testbed.student.body.imagination import Imagination
from testbed.student.body.settling import Settler
from testbed.student.parameters import ImaginationParameters
from testbed.vision import render
from testbed.world.env import World
from testbed.world.placement import STUDENT

TRIAL = """\
name: guarded
seed: 7
student: paper
beside: [like_me]
world: {physics_step: 0.0166666667}
rig: {renderer: analytic, camera_rate: 5}
teachers: [{robot: crawler, gait: crawl, distance: 0.9, bearing_deg: -30}]
"""
STEPS_OF_A_TRIAL, STEPS_TO_SETTLE = 3385, 4188
IN_THE_MIND, IN_THE_WORLD = 24.5, 166
COUNTED = ("stepSimulation", "loadURDF", "connect", "getCameraImage", "performCollisionDetection")


@pytest.fixture(scope="module")
def imagination() -> Iterator[Imagination]:
    with Imagination(ImaginationParameters(), living.CONTROL_STEP) as opened:
        yield opened


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often PyBullet was called, by function."""
    counts: Counter[str] = Counter()
    for name in COUNTED:

        def counting(*args: Any, _name: str, _real: Callable[..., Any], **words: Any) -> Any:
            counts[_name] += 1
            return _real(*args, **words)

        monkeypatch.setattr(pybullet, name, partial(counting, _name=name, _real=getattr(pybullet, name)))
    return counts


def interpreted(call: Callable[[], object]) -> int:
    """How many functions the interpreter calls, Python's and C's: work that is the same each time."""
    count = 0

    def note(frame: FrameType, event: str, argument: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    call()  # what is done once is not counted
    before = sys.getprofile()
    sys.setprofile(note)
    try:
        call()
    finally:
        sys.setprofile(before)
    return count


def test_a_trial_takes_no_more_physics_than_it_did(calls: Counter[str]) -> None:
    """Two students, one teacher, short searches, no pictures by Bullet; elsewhere a search may round astray."""
    run_trial(with_overrides(parse_scenario(TRIAL), smoke=True), 0)
    assert 0 < calls["stepSimulation"] <= 1.02 * STEPS_OF_A_TRIAL
    assert 0 < calls["connect"] <= 4  # the world, and what each student imagines in
    assert calls["loadURDF"] <= 9
    assert calls["getCameraImage"] == 0


def test_a_self_model_that_settles_takes_no_more_physics(
    calls: Counter[str], imagination: Imagination
) -> None:
    bodies, commands = living.self_models(4)
    for body, asked in zip(bodies, commands, strict=True):
        imagination.settle(body, asked, limit=living.PAPER.settle_time, rest_speed=living.PAPER.rest_speed)
    assert 0 < calls["stepSimulation"] <= STEPS_TO_SETTLE
    assert 0 < calls["loadURDF"] <= 4


def test_the_quasi_static_solver_asks_no_physics(calls: Counter[str]) -> None:
    body = load_robot("crawler")
    Settler(body).follow(living.gaits(body, 1)[0], living.SERVOS)
    assert not calls


def test_what_is_interpreted_around_the_physics_does_not_grow(imagination: Imagination) -> None:
    """Calls of the interpreter, a quarter more than there are for other versions of the libraries."""
    body = load_robot("crawler")
    motion = living.gaits(body, 1)[0][:60]
    with imagination.imagine(body) as rehearsal:
        a_step_in_the_mind = interpreted(lambda: rehearsal.move(motion)) / len(motion)
    world = World(load_scenario("whom_to_imitate"), images=False, max_cycles=1000)
    world.reset(seed=7)
    still = {name: body.rest for name, body in world.backend.robots.items()}
    still[STUDENT] = np.append(still[STUDENT], 0.0)
    a_step_of_the_world = interpreted(lambda: world.step(still))
    world.close()
    assert 4 <= a_step_in_the_mind <= 1.25 * IN_THE_MIND
    assert 12 <= a_step_of_the_world <= 1.25 * IN_THE_WORLD


def test_the_kernel_is_still_many_times_numpy() -> None:
    """Measured: 60. A ratio in the same turns hardly depends on the machine and its load."""
    seen, scenes = rays(pixels(1000)), models(3)
    others = seeing.one_by_one(numpy_rays.open_eye(seen, RIG.eyes[0]), scenes)
    times = interleaved({"ours": seeing.kernel(scenes, seen, RIG.eyes[0]), "numpy": others}, 7, turn=0.01)
    assert ratio(times["numpy"], times["ours"] / len(scenes))[0] > 15


def test_a_pass_of_modelling_is_still_many_times_the_plain_loop() -> None:
    """Measured: 90."""
    images = render(models(3, 1)[0], RIG)
    calls: dict[str, Callable[[], object]] = {
        "ours": partial(modelling.ours, images, 7),
        "plain": modelling.plainly(modelling.with_numpy(), images, 10),
    }
    times = interleaved(calls, 3, turn=0.0)
    assert ratio(times["plain"] * (modelling.PASSES / 10), times["ours"])[0] > 20


def test_the_quasi_static_solver_is_still_many_times_the_simulation(imagination: Imagination) -> None:
    """Measured: 150."""
    (body, *_), (asked, *_) = living.self_models(1)
    calls: dict[str, Callable[[], object]] = {
        "solver": lambda: Settler(body).tilt(asked),
        "physics": lambda: imagination.settle(body, asked, limit=1.5, rest_speed=0.02),
    }
    times = interleaved(calls, 5, turn=0.01)
    assert ratio(times["physics"], times["solver"])[0] > 30


def test_a_target_is_met_when_the_whole_interval_is() -> None:
    ours, theirs = np.array([1.0, 1.0, 1.0]), np.array([1.9, 2.0, 2.1])
    assert faster("a", "b", theirs, ours, 1.8).met is True
    assert faster("a", "b", theirs, ours, 1.95).met is False
    assert faster("a", "b", theirs, ours).met is None
    assert within("a", 1.5, ours).met is True
    assert measured("a", "exponent", (1.0, 0.9, 1.2), 1.1, "at most").met is False
    assert left_out("a", "b", "it rains").met is None


def test_a_missed_target_says_how_far_and_why() -> None:
    row = faster("a", "b", np.full(3, 2.0), np.full(3, 1.0), 4.0, note="warm", why="it rains")
    assert table.remark(row.as_json()) == "warm; missed: 2 instead of 4, 50% of it: it rains"


def test_a_power_law_is_found() -> None:
    sizes = (1, 2, 4, 8)
    seconds = np.array([[0.1 * size**1.5 for size in sizes]] * 3)
    assert exponent(sizes, seconds) == pytest.approx((1.5, 1.5, 1.5))


def test_a_peer_that_is_not_there_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingError, match=r"mujoco is not installed \(pip"):
        mujoco_eyes.import_mujoco()


@pytest.fixture
def invented(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Three groups, the second of which is stopped; the folder where everything is written."""

    def fine(settings: Settings) -> Iterator[Row]:
        yield within("quick", 1.0, np.full(settings.rounds, 0.5))

    def stopped(settings: Settings) -> Iterator[Row]:
        yield left_out("slow", "a peer", "nobody came")
        raise KeyboardInterrupt

    made = {
        name: groups.Group(rows, name, 1) for name, rows in (("one", fine), ("two", stopped), ("three", fine))
    }
    monkeypatch.setattr(groups, "GROUPS", made)
    monkeypatch.setattr(results, "FILE", tmp_path / "results.json")
    monkeypatch.setattr(command, "DOCUMENT", tmp_path / "benchmarks.md")
    (tmp_path / "benchmarks.md").write_text(f"before\n{table.BEGIN}\nold\n{table.END}\nafter\n")
    return tmp_path


def test_what_is_finished_is_kept_when_stopped(invented: Path) -> None:
    assert command.main([]) == 130
    assert command.main(["three"]) == 0
    kept = json.loads((invented / "results.json").read_text())
    assert list(kept["groups"]) == ["one", "three"]
    assert [row["met"] for row in kept["rows"]] == [True, True]
    assert "old" in (invented / "benchmarks.md").read_text()  # half a table is not for the documentation


def test_a_group_that_fails_is_told_and_the_others_are_measured(
    invented: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def failing(settings: Settings) -> Iterator[Row]:
        raise RuntimeError("no such thing")
        yield

    monkeypatch.setitem(groups.GROUPS, "two", groups.Group(failing, "two", 1))
    assert command.main([]) == 1
    assert "two failed" in capsys.readouterr().out
    assert list(json.loads((invented / "results.json").read_text())["groups"]) == ["one", "three"]


def test_the_documentation_is_written_when_all_is_measured(
    invented: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(groups.GROUPS, "two", groups.GROUPS["one"])
    assert command.main(["--rounds", "3"]) == 0
    written = (invented / "benchmarks.md").read_text()
    assert written.startswith("before\n")
    assert written.endswith("after\n")
    assert "| quick | limit | 500 ms | 1 s |" in written
    assert "old" not in written
