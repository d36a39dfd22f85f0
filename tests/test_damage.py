"""Damage: noticed soon, the right limb named, a new body made of what is left, and no false alarm."""

from __future__ import annotations

import math

import numpy as np
import pytest
from test_settling import prior_of

from testbed.bodies.morphology import Morphology, Vector
from testbed.student.body.active_discovery import ActiveDiscovery
from testbed.student.body.damage import SelfCheck, Surprise
from testbed.student.body.damage_report import DamageReport, carried_by, damaged
from testbed.student.body.genomes import Tree, body_of
from testbed.student.body.posterior import SelfKnowledge
from testbed.student.body.settling import Settler
from testbed.student.parameters import ActiveDiscoveryParameters, DamageParameters

NOISE = math.radians(0.5)
ANGLES = np.radians([50.0, 120.0])


def knowledge_of(tree: Tree) -> tuple[SelfKnowledge, Morphology]:
    body = body_of(prior_of(2), tree, ANGLES, np.ones(2))
    discovery = ActiveDiscovery(prior_of(2), ActiveDiscoveryParameters(), np.random.default_rng(0))
    rng = np.random.default_rng(1)
    while discovery.wants_more:
        command = discovery.next_command()
        discovery.tell(command, Settler(body).tilt(command[None])[0] + rng.normal(0, NOISE, 2))
    knowledge = discovery.record()
    assert knowledge.parents == tree
    return knowledge, body


@pytest.fixture(scope="module", params=[(0, 1), (0, 0)], ids=["chain", "splayed"])
def known(request: pytest.FixtureRequest) -> tuple[SelfKnowledge, Morphology]:
    return knowledge_of(request.param)


def live(
    knowledge: SelfKnowledge,
    body: Morphology,
    motors: tuple[int, ...],
    stuck: dict[int, float],
    count: int = 5,
) -> tuple[DamageReport, list[Surprise | None]]:
    """The student checks itself, with the body that it now has."""
    check, rng = SelfCheck(knowledge, DamageParameters(), np.random.default_rng(2)), np.random.default_rng(3)
    surprises = []
    for _ in range(count):
        command = check.next_command()
        real: Vector = command.copy()
        for limb, angle in stuck.items():
            real[limb] = angle
        felt = Settler(body).tilt(real[list(motors)][None])[0] if motors else np.zeros(2)
        surprises.append(check.tell(command, felt + rng.normal(0, NOISE, 2)))
    return check.record(), surprises


def test_a_whole_body_raises_no_alarm(known: tuple[SelfKnowledge, Morphology]) -> None:
    report, surprises = live(*known, (0, 1), {}, count=8)
    assert surprises == [None] * 8
    assert report.kind == "none"
    assert (report.noticed_after, report.limb, report.joint) == (None, None, None)
    assert report.motors == (0, 1)
    assert "as I know it" in report.words[0]


@pytest.mark.parametrize("limb", [0, 1])
def test_a_lost_limb_is_noticed_and_named(known: tuple[SelfKnowledge, Morphology], limb: int) -> None:
    knowledge, body = known
    left, motors = damaged(body, "limb_lost", limb, None)
    report, surprises = live(knowledge, left, motors, {})
    assert report.noticed_after is not None
    assert report.noticed_after <= 3
    assert surprises[report.noticed_after - 1] is not None
    assert report.limb == limb
    assert report.kind == "limb_lost"
    assert report.motors == motors
    assert len(report.body.parts) == len(left.parts)
    assert f"limb_{'ab'[limb]}" in report.words[0]


@pytest.mark.parametrize(("limb", "angle_deg"), [(0, 0.0), (1, 0.0), (0, 40.0), (1, 30.0)])
def test_a_locked_joint_is_noticed_and_named(
    known: tuple[SelfKnowledge, Morphology], limb: int, angle_deg: float
) -> None:
    knowledge, body = known
    report, _ = live(knowledge, body, (0, 1), {limb: math.radians(angle_deg)})
    assert report.noticed_after is not None
    assert report.noticed_after <= 3
    assert report.limb == limb
    assert report.joint == f"joint_{'ab'[limb]}"
    if report.kind == "joint_locked":  # locked flat, it may do what a lost limb does: nothing
        assert report.locked_angle is not None
        assert math.degrees(report.locked_angle) == pytest.approx(angle_deg, abs=12)
        low, high = report.body.joints[report.joint].limits_deg
        assert high - low == pytest.approx(1.0)
    else:
        assert angle_deg == 0.0


def test_with_a_limb_goes_all_that_hangs_on_it() -> None:
    assert carried_by((0, 1, 2, 0), 0) == [0, 1, 2]
    assert carried_by((0, 1, 2, 0), 2) == [2]
    assert carried_by((2, 0), 1) == [0, 1]
    body = body_of(prior_of(4), (0, 1, 2, 0), np.zeros(4), np.ones(4))
    left, motors = damaged(body, "limb_lost", 1, None)
    assert list(left.parts) == ["main", "limb_a", "limb_d"]
    assert motors == (0, 3)
    assert damaged(body, "none", -1, None) == (body, (0, 1, 2, 3))


def test_the_same_seed_checks_the_same(known: tuple[SelfKnowledge, Morphology]) -> None:
    checks = [SelfCheck(known[0], DamageParameters(), np.random.default_rng(7)) for _ in range(2)]
    first, second = (check.next_command() for check in checks)
    assert np.array_equal(first, second)
