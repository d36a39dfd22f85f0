"""What can no longer win is not imagined to its end, and nothing that a student comes to believe changes by it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pybullet
import pytest
from scipy.spatial.transform import Rotation

from testbed.bodies.morphology import load_robot
from testbed.physics import Simulation
from testbed.student.body.imagination import Imagination
from testbed.student.body.self_discovery import evolve_self_model, mutate, random_genome, tilt_error
from testbed.student.body.self_model import BodyPrior, self_model
from testbed.student.moving.beaten import Beaten
from testbed.student.moving.imitation import ImitationRecord, evolve_controller, imitation_error
from testbed.student.moving.rolls import RollReading, headings, read_rolls, roll_of, view_of
from testbed.student.parameters import ImaginationParameters, ImitationParameters, SelfDiscoveryParameters
from testbed.student.search import HillClimber
from testbed.vision.primitives import OMEGA, X, Y

CRAWLER = load_robot("crawler")
PRIOR = BodyPrior.of(CRAWLER)
ASKEW = CRAWLER.varied(joints={"joint_a": {"angle_deg": 130}, "joint_b": {"angle_deg": -70}})


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """Tells how many physics steps have passed since it was asked last."""
    really, passed = pybullet.stepSimulation, [0]

    def step(*args: Any) -> None:
        passed[0] += 1
        really(*args)

    monkeypatch.setattr(pybullet, "stepSimulation", step)

    def since() -> int:
        count, passed[0] = passed[0], 0
        return count

    return since


def imitated(reading: RollReading) -> ImitationRecord:
    """Forty tries to move as a made-up teacher does."""
    rng = np.random.default_rng(7)
    history = np.zeros((30, 3, 8))
    history[:, :, OMEGA] = rng.uniform(-1.5, 1.5, (3, 3)).repeat(10, axis=0)
    history[:, :, [X, Y]] = rng.normal(size=(3, 2))
    parameters = ImitationParameters(samples=30, iterations=40, weight_width=2, roll_reading=reading)
    with Imagination(ImaginationParameters(), 1 / 60) as mind:
        return evolve_controller(CRAWLER, history, mind, parameters, rng, lambda done, total: None)


@pytest.mark.parametrize("reading", ["half_turn", "raw", "unwrapped"])
def test_giving_up_changes_no_controller(
    reading: RollReading, steps: Callable[[], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    quick = imitated(reading)
    fewer = steps()
    monkeypatch.setattr(Beaten, "by", lambda self, error: lambda step, bases, joints: False)
    whole = imitated(reading)
    assert quick.weights.tobytes() == whole.weights.tobytes()
    assert quick.errors.tobytes() == whole.errors.tobytes()
    assert np.array(quick.responses).tobytes() == np.array(whole.responses).tobytes()
    assert len(np.unique(quick.errors)) > 3
    assert steps() == 41 * 30 * 4
    assert fewer == 41 * 30 * 4 if reading == "unwrapped" else fewer < 0.98 * 41 * 30 * 4


@pytest.mark.parametrize("reading", ["half_turn", "raw"])
def test_the_error_so_far_is_that_of_equation_5(reading: RollReading) -> None:
    """A motion is beaten by a little less than its error, at the last step, and never by a little more."""
    rng = np.random.default_rng(1)
    right, _ = view_of(ASKEW)
    for _ in range(20):
        bases = np.zeros((12, 7))
        bases[:, 3:] = Rotation.random(12, rng=rng).as_quat() * 1.1
        joints, wanted = rng.uniform(-2, 2, (12, 2)), rng.uniform(-1.5, 1.5, (12, 3))
        response = read_rolls(roll_of(headings(ASKEW, bases, joints), right), reading)
        error = imitation_error(wanted, np.arange(3), response)
        beaten = Beaten(ASKEW, right, wanted, reading)
        less, more = beaten.by(error * (1 - 1e-5)), beaten.by(error * (1 + 1e-9))
        assert [less(step, bases, joints) for step in range(12)] == [False] * 11 + [True]
        assert not any(more(step, bases, joints) for step in range(12))


def test_a_roll_that_rounding_could_turn_over_beats_nobody() -> None:
    """On its edge a main body may be read a quarter turn this way or that."""
    right, _ = view_of(CRAWLER)
    bases = np.array([[0, 0, 0, *Rotation.from_euler("y", math.pi / 2).as_quat()]])
    joints = np.zeros((1, 2))
    assert not Beaten(CRAWLER, right, np.zeros((1, 3)), "half_turn").by(1e-3)(0, bases, joints)
    assert Beaten(CRAWLER, right, np.zeros((1, 3)), "raw").by(1e-3)(0, bases, joints)


def test_giving_up_changes_no_self_model(steps: Callable[[], int]) -> None:
    """Against the plain hill climber, every command of every self-model in turn."""
    parameters = SelfDiscoveryParameters(iterations=25)
    commands = np.random.default_rng(3).uniform(*PRIOR.limits.T, (5, 2))
    with Imagination(ImaginationParameters(), 1 / 60) as mind:

        def settle(genome: np.ndarray) -> np.ndarray:
            return mind.settle(self_model(PRIOR, genome), commands, limit=1.5, rest_speed=0.02)

        tilt = mind.settle(CRAWLER, commands, limit=1.5, rest_speed=0.02)
        steps()
        quick = evolve_self_model(
            PRIOR, commands, tilt, mind, parameters, np.random.default_rng(5), lambda done, total: None
        )
        fewer = steps()
        rng = np.random.default_rng(5)
        start = random_genome(2, rng)
        believed = [settle(start)]
        climber = HillClimber(start, tilt_error(tilt, believed[0]))
        for _ in range(25):
            child = mutate(climber.parent, parameters, rng)
            felt = settle(child)
            believed.append(felt if climber.tell(child, tilt_error(tilt, felt)) else believed[-1])
    assert quick.genomes.tobytes() == np.array(climber.parents).tobytes()
    assert quick.errors.tobytes() == np.array(climber.errors).tobytes()
    assert quick.believed_tilt.tobytes() == np.array(believed).tobytes()
    assert fewer < 0.7 * steps()


def test_followed_targets_move_a_body_as_commands_do() -> None:
    targets = np.random.default_rng(0).uniform(-1.5, 1.5, (6, 2)).repeat(4, axis=0)
    targets[9:13, 1] = math.nan
    with Simulation() as followed, Simulation() as commanded:
        for simulation in (followed, commanded):
            simulation.add("robot", CRAWLER)
            simulation.lock("robot", "joint_a")
            simulation.command("robot", np.array([0.3, -0.4]))
        for target, (base, joints) in zip(targets, followed.follow("robot", targets, 3), strict=True):
            commanded.command("robot", target)
            commanded.step(3)
            assert base == tuple(commanded.base("robot"))
            assert joints == commanded.joints("robot").tolist()
