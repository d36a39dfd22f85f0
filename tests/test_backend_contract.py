"""What every backend does, simulated or on a bench: one suite for all of them.

The bench is the emulated one: the shipped firmware on emulated boards, cameras with lenses, in virtual time.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_builder import SEED, calibrated
from pettingzoo.test import parallel_api_test
from simavr_needed import simavr_or_skip

from testbed.experiment.stage import Truth
from testbed.frames import tilt_of
from testbed.scenario import Scenario, drawn, load_scenario
from testbed.world.backend import Backend
from testbed.world.bullet import SimulatedBackend
from testbed.world.env import World
from testbed.world.placement import STUDENT

KINDS = ("tinyrenderer", "analytic", "bench")
SEEDS = np.random.SeedSequence(5)


@dataclass(frozen=True)
class Subject:
    """A backend, and who knows the truth about its world."""

    backend: Backend
    truth: Truth

    @property
    def step(self) -> float:
        return 1 / 30

    def hold(self, seconds: float, pan: float = 0.0, **targets: list[float]) -> None:
        """Let time pass; joints in degrees, whoever is not named lies flat."""
        commands = {name: body.rest for name, body in self.backend.robots.items()}
        commands |= {name: np.radians(angles) for name, angles in targets.items()}
        for _ in range(round(seconds / self.step)):
            self.backend.apply(commands, pan)

    def joints(self, robot: str) -> np.ndarray:
        state = self.truth.state(robot)
        assert state is not None
        return np.degrees(state[1])

    def tilt(self, robot: str) -> np.ndarray:
        state = self.truth.state(robot)
        assert state is not None
        return tilt_of(state[0][3:])


@pytest.fixture(scope="module")
def here() -> Scenario:
    return drawn(load_scenario("bench"), 0)


@pytest.fixture(scope="module")
def make(here: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Subject]]:
    """Makes subjects; all are closed in the end."""
    closing: list[Any] = []
    calibrations: list[Path] = []

    def on_bench() -> Subject:
        simavr_or_skip()  # type: ignore[no-untyped-call]
        from testbed.hardware.emulation.bench import EmulatedBench
        from testbed.hardware.operating.stage import BenchStage, workbench_of

        ports = tmp_path_factory.mktemp("ports")
        bench = EmulatedBench(here, seed=SEED, ports=ports)
        closing.append(bench)
        if not calibrations:
            calibrations.append(calibrated(bench, tmp_path_factory.mktemp("calibrations")))
        stage = BenchStage(here, workbench_of(bench, ports, calibrations[0]), truth=bench)
        closing.append(stage)
        return Subject(stage.backend, bench)

    def made(kind: str) -> Subject:
        if kind == "bench":
            return on_bench()
        rig = here.rig.model_copy(update={"renderer": kind})
        backend = SimulatedBackend(here.model_copy(update={"rig": rig}))
        closing.append(backend)
        return Subject(backend, backend)

    yield made
    for thing in reversed(closing):
        thing.close()


@pytest.fixture(params=KINDS, scope="module")
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def living(kind: str, make: Callable[[str], Subject]) -> Subject:
    return make(kind)


@pytest.fixture
def subject(living: Subject) -> Subject:
    """One world for all tests, put back before each."""
    living.backend.reset(SEEDS)
    return living


def test_everybody_is_there_and_joints_are_in_the_bodys_order(subject: Subject) -> None:
    assert list(subject.backend.robots) == ["student", "teacher_0", "teacher_1"]
    for robot in subject.backend.robots:
        subject.hold(0.6, 0.0, **{robot: [-20.0, -35.0]})
        assert subject.joints(robot) == pytest.approx([-20, -35], abs=2.0)
    assert list(subject.backend.robots["student"].joints) == ["joint_a", "joint_b"]


def test_a_posture_is_reached_in_the_time_that_its_servos_take(subject: Subject) -> None:
    """60 degrees at 300 degrees a second, and two pulses of 20 ms until a servo has heard of it."""
    subject.hold(0.1, student=[-60.0, 0.0])
    assert subject.joints(STUDENT)[0] > -40
    subject.hold(0.2, student=[-60.0, 0.0])
    assert subject.joints(STUDENT) == pytest.approx([-60, 0], abs=2.5)


def test_nobody_turns_beyond_the_bodys_limits(subject: Subject, here: Scenario) -> None:
    subject.hold(0.8, student=[-150.0, 0.0])
    assert subject.joints(STUDENT)[0] == pytest.approx(-90, abs=2.5)


def front_up(crawler: Any, degrees: float) -> float:
    """How far (rad) a crawler's nose is up while it props itself on its limbs, stretched out at an angle downward.

    It stands on its rear lower edge and the tip of the outer limb: both are equally high.
    """
    box, limb, angle = crawler.parts["body"], crawler.parts["limb_a"], math.radians(degrees)
    reach = 2 * limb.length  # from the hinge to the middle of the last cap
    across = box.size[0] + reach * math.cos(angle)
    above = box.size[2] / 2 - reach * math.sin(angle)
    # across sin(x) + above cos(x) = radius
    return math.asin(limb.radius / math.hypot(across, above)) - math.atan2(above, across)


@pytest.mark.parametrize("degrees", [25.0, 40.0])
def test_tilt_is_what_geometry_says(subject: Subject, degrees: float) -> None:
    """Nose up is negative, and as far as the limb props it up."""
    subject.hold(1.5, student=[degrees, 0.0])
    expected = front_up(subject.backend.robots[STUDENT], degrees)
    assert expected > math.radians(8)
    read = np.mean([tilt_in(subject) for _ in range(10)], axis=0)
    assert read == pytest.approx([0.0, -expected], abs=math.radians(2.5))


def tilt_in(subject: Subject) -> np.ndarray:
    """The student's tilt one step later."""
    subject.backend.apply({}, 0.0)
    return subject.backend.tilt(STUDENT)


def test_tilt_is_noisy_but_not_very(subject: Subject) -> None:
    readings = np.array([tilt_in(subject) for _ in range(40)])
    assert np.all(readings.std(axis=0) > 0)
    assert np.all(readings.std(axis=0) < math.radians(1.0))
    assert readings.mean(axis=0) == pytest.approx(subject.tilt(STUDENT), abs=math.radians(0.6))


def test_movement_is_the_speed_of_the_fastest_limb(subject: Subject) -> None:
    subject.hold(0.2)
    assert subject.backend.movement(STUDENT) < math.radians(2)
    speeds = []
    for step in range(1, 9):
        subject.hold(subject.step, student=[-4.0 * step, -2.0 * step])
        speeds.append(subject.backend.movement(STUDENT))
    assert speeds[0] > math.radians(20)  # what is sensed after a step is how it is then
    assert np.mean(speeds[2:]) == pytest.approx(math.radians(4) / subject.step, rel=0.25)
    assert subject.backend.movement("teacher_0") == 0.0


def test_pictures_have_shape_and_rate(subject: Subject) -> None:
    frames = [subject.backend.look()]
    exposed = [subject.backend.exposed]
    assert frames[0].shape == (2, 75, 100)
    assert frames[0].dtype == np.uint8
    # Somebody must be in view: white is exactly white on a bench, without noise.
    subject.hold(0.5, pan=math.radians(-30))
    for _ in range(12):
        subject.hold(subject.step, pan=math.radians(-30))
        frames.append(subject.backend.look().copy())
        exposed.append(subject.backend.exposed)
    changes = [not np.array_equal(one, other) for one, other in itertools.pairwise(frames[1:])]
    assert sum(changes) in (5, 6)  # 15 pairs in 30 steps a second
    assert 15 + 9 <= exposed[-1] <= 15 + 12
    assert exposed == sorted(exposed)


def middle(image: np.ndarray) -> float:
    """The column of the middle of all darkness."""
    darkness = np.where(image < 235, 255.0 - image, 0.0).sum(axis=0)
    return float(darkness @ np.arange(100) / darkness.sum())


def test_the_rig_turns_at_its_speed_and_what_is_seen_moves_the_other_way(subject: Subject) -> None:
    subject.hold(0.2, pan=math.radians(-35))
    assert subject.backend.pan == pytest.approx(-0.2 * math.radians(90), abs=math.radians(0.5))
    subject.hold(0.5, pan=math.radians(-35))
    assert subject.backend.pan == pytest.approx(math.radians(-35), abs=math.radians(0.2))
    farther_left = middle(subject.backend.look()[0])
    subject.hold(0.3, pan=math.radians(-30))
    focal = 50 / math.tan(math.radians(25))
    moved = farther_left - middle(subject.backend.look()[0])
    assert moved == pytest.approx(focal * math.tan(math.radians(5)), rel=0.3)


def test_nearness_shows_in_disparity(subject: Subject) -> None:
    """The teacher's middle is at 0.9 m; what the left eye sees is farther right."""
    subject.hold(0.8, pan=math.radians(-30))
    left, right = subject.backend.look()
    focal = 50 / math.tan(math.radians(25))
    assert middle(left) - middle(right) == pytest.approx(focal * 0.10 / 0.9, abs=0.8)


def test_backgrounds_are_white(subject: Subject) -> None:
    subject.hold(0.8, pan=0.0)
    assert np.median(subject.backend.look()) > 245
    subject.hold(0.8, pan=math.radians(-30))
    left, _ = subject.backend.look()
    assert 0.02 < (left < 180).mean() < 0.4


def test_an_overview_for_people(subject: Subject) -> None:
    picture = subject.backend.picture(160, 120)
    assert picture.shape == (120, 160, 3)
    assert picture.dtype == np.uint8
    assert np.ptp(picture) > 30


def lived(subject: Subject, steps: int = 24) -> bytes:
    """All that there is to be sensed in some steps after a reset."""
    backend, chance, log = subject.backend, np.random.default_rng(1), []
    backend.reset(np.random.SeedSequence(8))
    for step in range(steps):
        commands = {
            name: np.asarray(chance.uniform(*body.limits.T)) / 2 for name, body in backend.robots.items()
        }
        backend.apply(commands, 0.02 * step)
        log += [
            backend.look().tobytes(),
            backend.pan.hex().encode(),
            backend.movement(STUDENT).hex().encode(),
        ]
        log += [backend.tilt(name).tobytes() for name in backend.robots]
    return b"".join(log)


def test_equal_seeds_repeat_bit_for_bit(kind: str, make: Callable[[str], Subject]) -> None:
    """On a bench nature is not to be reset; a bench of the same make, fresh, does the same."""
    first = make(kind)
    again = make(kind) if kind == "bench" else first
    assert lived(first) == lived(again)


def test_pettingzoos_own_test(living: Subject, here: Scenario) -> None:
    world = World(here, backend=living.backend)
    for number, agent in enumerate(world.possible_agents):
        # By themselves they may throw a body about until its sensor is doubted.
        world.action_space(agent).seed(number)
    parallel_api_test(world, num_cycles=12)


def test_letting_go_twice_is_harmless(kind: str, make: Callable[[str], Subject]) -> None:
    subject = make(kind)
    subject.backend.reset(SEEDS)
    subject.backend.close()
    subject.backend.close()


def test_who_is_let_go_is_limp(make: Callable[[str], Subject]) -> None:
    """The limb that was up in the air lies on the ground a second later."""
    subject = make("bench")
    bench: Any = subject.truth
    subject.backend.reset(SEEDS)
    subject.hold(0.6, student=[-70.0, 0.0])
    assert not bench.boards[STUDENT].limp
    subject.backend.close()
    pulses = len(bench.boards[STUDENT].pulses)
    bench.advance(1.0)
    assert all(board.limp for board in bench.boards.values())
    assert len(bench.boards[STUDENT].pulses) <= pulses + 1
    assert subject.joints(STUDENT)[0] > -10
